"""Packages that a run must not import at its start."""

import subprocess
import sys

import example_robot_data
import pytest

from nsaid_mj.errors import BadRobot
from nsaid_mj.robot.loading import load_robot


def modules_after(code: str) -> set[str]:
    """What a fresh process has imported at its end, whatever else it prints."""
    program = f"import sys, atexit\natexit.register(lambda: print('\\n', *sys.modules))\n{code}"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=120
    )
    return set(done.stdout.splitlines()[-1].split())


def test_a_run_and_its_report_import_only_what_they_use():
    modules = modules_after("import nsaid_mj.recording.postprocessing, nsaid_mj.experiment.loop")
    assert "nsaid_mj.pages.report" in modules
    assert not modules & {"rerun", "matplotlib", "jinja2", "pyarrow.compute", "pebble", "dask"}
    assert not modules & {"scipy.signal", "scipy.optimize", "scipy.interpolate", "scipy.stats"}


def test_meshes_are_loaded_on_first_access():
    robot, theirs = load_robot("solo12", "free"), example_robot_data.load("solo12")
    assert "parts" not in vars(robot.visuals)
    for model in (robot.model, theirs.model):  # the loader limits the base, which nothing reads
        model.lowerPositionLimit[:7] = model.upperPositionLimit[:7] = 0.0
    for pose in theirs.model.referenceConfigurations:  # nor these
        robot.model.referenceConfigurations[pose.key()] = pose.data()
    assert robot.model == theirs.model
    found = [(p.mesh.name, p.place, len(p.mesh.triangles)) for p in robot.visuals.parts]
    wanted = theirs.visual_model.geometryObjects
    assert found == [(g.name, g.placement, g.geometry.num_tris) for g in wanted]
    assert found


def test_a_fixed_base_robots_meshes_belong_to_its_fixed_base_model():
    robot = load_robot("solo12")
    assert robot.model.nv == 12
    parents = {part.joint for part in robot.visuals.parts}
    assert max(parents) == robot.model.njoints - 1


@pytest.mark.parametrize("name", ["cassie", "talos_legs"])
def test_a_robot_that_no_urdf_describes_is_refused(name):
    assert load_robot("ur5").visuals.parts
    with pytest.raises(BadRobot, match=name):
        load_robot(name)
