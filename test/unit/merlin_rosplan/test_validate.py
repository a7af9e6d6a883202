from pathlib import Path

import pytest

from merlin_rosplan.validate import validate

HOME = Path(__file__).resolve().parents[3] / "pddl" / "home"
DOMAIN, PROBLEM = str(HOME / "domain.pddl"), str(HOME / "problem.pddl")


def run(capsys, *arguments):
    code = validate([str(argument) for argument in arguments])
    return code, capsys.readouterr().out


def test_home_domain_is_valid(capsys):
    code, output = run(capsys, DOMAIN, PROBLEM)
    assert code == 0 and "domain 'home': 2 types, 2 predicates" in output and "warning" not in output


def test_goal_with_a_plan(capsys):
    code, output = run(capsys, DOMAIN, PROBLEM, "(checked kitchen)")
    assert code == 0 and "(navigate anywhere kitchen)" in output and "(ask kitchen)" in output


@pytest.mark.parametrize(
    "goal, reason",
    [
        ("(checked kitchn)", "goal:1:10: unknown object 'kitchn' (did you mean 'kitchen'?)"),
        ("(checked kitchen", "goal:1:1: the '(' of '(checked' is never closed"),
        (
            "(and (robot_at kitchen) (robot_at bathroom))",
            "no plan for (robot_at kitchen) (robot_at bathroom)",
        ),
    ],
)
def test_goal_that_cannot_be(capsys, goal, reason):
    code, output = run(capsys, DOMAIN, PROBLEM, goal)
    assert code == 1 and reason in output and "NOT valid" in output


def test_errors_name_file_line_and_column(capsys, tmp_path):
    broken = tmp_path / "broken.pddl"
    broken.write_text(Path(DOMAIN).read_text().replace("(at end (robot_at ?to))", "(at end (robot_t ?to))"))
    code, output = run(capsys, broken)
    assert code == 1 and f"{broken}:25:" in output and output.count("did you mean 'robot_at'") == 1
    code, output = run(capsys, DOMAIN, tmp_path / "missing.pddl")
    assert code == 1 and "missing.pddl: cannot be read: No such file" in output


def test_wrong_usage(capsys):
    with pytest.raises(SystemExit) as caught:
        validate([])
    assert caught.value.code == 2
