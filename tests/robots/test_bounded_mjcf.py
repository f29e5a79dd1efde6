"""What an MJCF asks of memory is bounded before MuJoCo compiles it."""

from pathlib import Path

import pytest

from nsaid_mj.robots import BadRobot, load_tree

MODEL = """<mujoco><size nuser_body="{user}"/>
<asset><texture name="sky" type="{kind}" builtin="gradient" width="{width}" height="{height}"/>
<texture name="far" type="2d" file="far.png"/><material name="m" texture="far"/></asset>
<worldbody><body><joint name="hinge"/><geom size=".1" material="m"/></body></worldbody>
<actuator><motor joint="hinge"/></actuator><keyframe><key qpos="{key}"/></keyframe></mujoco>"""
HEAD = b"\x89PNG\r\n\x1a\n" + bytes([0, 0, 0, 13]) + b"IHDR"


def written(folder: Path, **changes: object) -> str:
    """A model with a skybox, and a picture of which only the header says how large it is."""
    given = {"user": 0, "kind": "skybox", "width": 8, "height": 48, "key": 0} | changes
    (folder / "arm.xml").write_text(MODEL.format(**given), encoding="utf-8")
    side = (20_000).to_bytes(4, "big")
    (folder / "far.png").write_bytes(HEAD + side + side + bytes([8, 2, 0, 0, 0]))
    return str(folder / "arm.xml")


def test_textures_beyond_all_use_are_left_out(tmp_path: Path) -> None:
    found = load_tree(written(tmp_path, width=20_000, height=120_000)).findings
    assert ["sky, far" in f.text for f in found if f.code == "large_texture"] == [True]


def test_a_hundred_million_numbers_of_a_users_own_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BadRobot, match=r"nuser_body is 100000000"):
        load_tree(written(tmp_path, user=100_000_000))


def test_a_keyframe_of_nan_is_refused_and_mujoco_writes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    path = written(tmp_path, key="nan")
    with pytest.raises(BadRobot, match="NaN"):
        load_tree(path)
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists()
