"""The parts of a simulated robot: base, laser, camera, and a localisation that is told the truth."""
