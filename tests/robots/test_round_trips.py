"""Random robots: what is written is what was identified, in each format."""

from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np
import pinocchio as pin
from hypothesis import given, settings
from hypothesis import strategies as st

from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.robots.inertias import is_physical, moved_inside
from nsaid_mj.robots.mjcf_export import write_mjcf
from nsaid_mj.robots.urdf import write_urdf

from .test_mjcf_export import difference
from .test_tree import bodies
from .urdfs import link, robot
from .values import identified, same_inertias

numbers = st.floats(-1, 1).map(lambda x: round(x, 3))


def triple(draw):
    return " ".join(str(draw(numbers)) for _ in range(3))


@st.composite
def urdfs(draw):
    """A URDF whose links hang at random on earlier ones, and names of joints to lock."""
    count, parts, moving = draw(st.integers(1, 6)), [link("link_0")], []
    for i in range(1, count + 1):
        kind = draw(st.sampled_from(["revolute", "prismatic", "fixed"])) if i > 1 else "revolute"
        moving += [f"joint_{i}"] if kind != "fixed" else []
        origin = f'<origin xyz="{triple(draw)}" rpy="{triple(draw)}"/>'
        mass = str(draw(st.floats(0.1, 5).map(lambda x: round(x, 2))))
        parts.append(link(f"link_{i}", mass=mass, origin=origin))
        x, y, z = triple(draw).split()
        parts.append(
            f'<joint name="joint_{i}" type="{kind}"><child link="link_{i}"/>'
            f'<parent link="link_{draw(st.integers(0, i - 1))}"/>'
            f'<axis xyz="{x} {y} {float(z) + 2}"/>'
            f'<origin xyz="{triple(draw)}" rpy="{triple(draw)}"/>'
            f'<limit effort="1" velocity="1" lower="{draw(st.sampled_from([-1, 0.4]))}" upper="1"/>'
            "</joint>"
        )
    locked = draw(st.lists(st.sampled_from(moving), max_size=len(moving) - 1, unique=True))
    return robot(*draw(st.permutations(parts))), locked


@settings(max_examples=40, deadline=None)
@given(urdfs(), st.integers(0, 99))
def test_any_urdf_is_written_and_read_again(case, seed):
    text, locked = case
    with TemporaryDirectory() as folder:
        path = Path(folder, "robot.urdf")
        path.write_text(text)
        model = load_robot_model(str(path), lock=locked)
        values = identified(model, seed)
        write_urdf(model, values, Path(folder, "calibrated.urdf"))
        again = load_robot_model(str(Path(folder, "calibrated.urdf")), lock=locked)
        assert same_inertias(values.model, again.model)
        assert np.array_equal(again.damping, values.damping)
        write_mjcf(model, values, Path(folder, "calibrated.xml"))
        mj = mujoco.MjModel.from_xml_path(str(Path(folder, "calibrated.xml")))
        assert difference(mj, model, values) < 1e-10


@settings(max_examples=40, deadline=None)
@given(bodies(), st.data())
def test_any_mjcf_is_written_and_read_again(body, data):
    with TemporaryDirectory() as folder:
        path = Path(folder, "robot.xml")
        path.write_text(f'<mujoco><compiler angle="radian"/><worldbody>{body}</worldbody></mujoco>')
        names = list(load_robot_model(str(path)).joints)
        locked = data.draw(st.lists(st.sampled_from(names), max_size=len(names) - 1, unique=True))
        model = load_robot_model(str(path), lock=locked)
        values = identified(model, data.draw(st.integers(0, 99)))
        write_mjcf(model, values, Path(folder, "calibrated.xml"))
        mj = mujoco.MjModel.from_xml_path(str(Path(folder, "calibrated.xml")))
        assert difference(mj, model, values) < 1e-10
        again = load_robot_model(str(Path(folder, "calibrated.xml")))
        assert same_inertias(values.model, again.model)


@settings(max_examples=100, deadline=None)
@given(
    st.lists(st.floats(-2, 2), min_size=6, max_size=6),
    st.floats(1e-3, 3),
    st.floats(1e-3, 2),
)
def test_any_inertia_becomes_physical(entries, mass, size):
    tensor = np.zeros((3, 3))
    tensor[np.triu_indices(3)] = entries
    tensor = np.triu(tensor) + np.triu(tensor, 1).T
    changed = moved_inside(mass, tensor, size)
    assert is_physical(mass, changed)
    assert np.allclose(moved_inside(mass, changed, size), changed, rtol=1e-9)
    parameters = pin.Inertia(mass, np.ones(3), changed).toDynamicParameters()
    P = pin.PseudoInertia.FromDynamicParameters(parameters).toMatrix()
    assert np.linalg.eigvalsh(P)[0] > 0
