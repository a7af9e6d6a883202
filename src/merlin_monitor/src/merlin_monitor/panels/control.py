"""The panel of the control: for operators only, it sends goals."""

from merlin_monitor.listeners.panel import Panel


class ControlPanel(Panel):
    """Goals that an operator sends."""

    name, place = "control", 3
