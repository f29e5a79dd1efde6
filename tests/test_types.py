"""What a user's type checker sees of the package."""

import json
import subprocess
import sys

import pytest

from tests.test_readme import README, ROOT, blocks

pytestmark = pytest.mark.slow  # a type checker reads the whole package

WRONG = """
from nsaid_mj import ArmPlant, BlueROV3Plant, identify

ArmPlant(robot="ur5", dampin=2.0)
ArmPlant(robot="ur5", damping="2")
identify("arm.urdf", "log.csv").verdikt
"""
"""A mistake in every line but the first two, and an unknown name in the second."""


def mistakes(code: str, folder, mode: str = "standard") -> list[tuple[int, str]]:
    """The lines at which pyright finds an error in a user's file, counted from 0, and its rules."""
    (folder / "mine.py").write_text(code, encoding="utf-8")
    (folder / "pyrightconfig.json").write_text(
        json.dumps({"typeCheckingMode": mode, "extraPaths": [str(ROOT)]}), encoding="utf-8"
    )
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "pyright",
            "--outputjson",
            "-p",
            folder,
            "--pythonpath",
            sys.executable,
        ],
        text=True,
        capture_output=True,
        check=False,
    )
    found = json.loads(done.stdout)["generalDiagnostics"]
    return [
        (each["range"]["start"]["line"], each.get("rule", ""))
        for each in found
        if each["severity"] == "error"
    ]


def test_the_readme_has_no_mistake(tmp_path):
    codes = blocks(README, "python")
    assert codes
    assert mistakes("\n".join(codes), tmp_path) == []


def test_a_lead_engineers_script_has_no_mistake_in_the_strict_mode(tmp_path):
    (code,) = blocks(ROOT / "docs" / "your_robot.md", "python")
    assert mistakes(code, tmp_path, "strict") == []


def test_a_users_mistake_is_an_error_in_the_editor(tmp_path):
    assert mistakes(WRONG, tmp_path) == [
        (1, "reportAttributeAccessIssue"),
        (3, "reportCallIssue"),
        (4, "reportArgumentType"),
        (5, "reportAttributeAccessIssue"),
    ]
