import mujoco
import numpy as np
import pytest

from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.robots.identified import inertial_parameters
from nsaid_mj.robots.mjcf_export import write_mjcf
from nsaid_mj.robots.tables import write_sysid

from .test_tree import TURNED
from .urdfs import chain
from .values import identified

yaml = pytest.importorskip("yaml")


@pytest.fixture(params=[("arm.urdf", chain()), ("arm.xml", TURNED)], ids=["urdf", "mjcf"])
def robot(request, tmp_path):
    name, text = request.param
    (tmp_path / name).write_text(text)
    return load_robot_model(str(tmp_path / name))


def from_theta(theta):
    """Mass, first moment and inertia about the origin, by the toolbox's own definition."""
    alpha, d1, d2, d3, s12, s23, s13, *t = theta
    U = np.array(
        [
            [np.exp(d1), s12, s13, t[0]],
            [0, np.exp(d2), s23, t[1]],
            [0, 0, np.exp(d3), t[2]],
            [0, 0, 0, 1],
        ]
    ) * np.exp(alpha)
    P = U @ U.T
    return P[3, 3], P[:3, 3], np.trace(P[:3, :3]) * np.eye(3) - P[:3, :3]


def test_the_sysid_dictionary_describes_the_exported_mjcf(robot, tmp_path):
    values, out = identified(robot), tmp_path / "calibrated.xml"
    write_mjcf(robot, values, out)
    write_sysid(robot, values, tmp_path / "sysid.yaml")
    found = yaml.safe_load((tmp_path / "sysid.yaml").read_text(encoding="utf-8"))
    mj = mujoco.MjModel.from_xml_path(str(out))
    for j in range(mj.njnt):
        body = mj.body(mj.jnt_bodyid[j])
        entry = found[f"{body.name}_inertia"]
        mass, h, _ = from_theta(entry["value"])
        assert mass == pytest.approx(body.mass[0], rel=1e-9)
        assert np.allclose(h / mass, body.ipos, atol=1e-9)
        assert (np.array(entry["min_value"]) < entry["value"]).all()
        assert (np.array(entry["value"]) < entry["max_value"]).all()
    assert found["gain"]["value"] == values.gain.tolist()
    assert len(found) == mj.njnt + 4


def test_log_cholesky_parameters_of_links_are_exact(tmp_path):
    (tmp_path / "arm.urdf").write_text(chain())
    robot = load_robot_model(str(tmp_path / "arm.urdf"))
    values = identified(robot)
    write_sysid(robot, values, tmp_path / "sysid.yaml")
    found = yaml.safe_load((tmp_path / "sysid.yaml").read_text(encoding="utf-8"))
    for k, own in enumerate(inertial_parameters(values.model)):
        mass, h, inertia = from_theta(found[f"link_{k + 1}_inertia"]["value"])
        xx, xy, yy, xz, yz, zz = own[4:]
        assert np.allclose(np.r_[mass, h], own[:4], atol=1e-12)
        assert np.allclose(inertia, [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], atol=1e-12)


def test_mujocos_own_toolbox_reads_it(robot, tmp_path):
    toolbox = pytest.importorskip("mujoco.sysid")
    if not hasattr(toolbox, "ParameterDict"):
        pytest.skip("mujoco.sysid lacks its own dependencies")
    write_sysid(robot, identified(robot), tmp_path / "sysid.yaml")
    assert toolbox.ParameterDict.load_from_disk(tmp_path / "sysid.yaml").size > 0
