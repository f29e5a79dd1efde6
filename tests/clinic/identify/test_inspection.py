"""`nsaid inspect` measures channels, writes a map that works, and never overwrites one."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

from nsaid_mj.base.findings import Finding
from nsaid_mj.cli.commands import command
from nsaid_mj.clinic.identify.fixing import fix
from nsaid_mj.clinic.identify.inspection import Inspection, figures_of, inspect, signal_names
from nsaid_mj.clinic.identify.inspection_page import _spans, inspection_page
from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.clinic.logs.checks import checked
from nsaid_mj.clinic.logs.first_map import first_map
from nsaid_mj.clinic.logs.mapping import map_of, read_map
from nsaid_mj.clinic.logs.preparation import prepare
from nsaid_mj.clinic.logs.signals import quantum
from nsaid_mj.clinic.logs.tables import Channel, LogTable, read_tables
from nsaid_mj.robots.assets import asset
from tests.support.robot_logs import columns, two_joints, write_csv

SIGNALS = ("Positions", "Velocities", "Commands")
URDF = '<robot name="arm"><link name="base"/>' + "".join(
    f'<link name="{name}_link"><inertial><mass value="2"/><origin xyz="0.2 0 0"/>'
    '<inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{name}_link"/>'
    '<origin xyz="0.4 0 0"/><axis xyz="0 -1 0"/>'
    '<limit lower="-2.5" upper="2.5" effort="99" velocity="9"/></joint>'
    for parent, name in (("base", "shoulder"), ("shoulder_link", "elbow"))
)
URDF += "</robot>"


def figures(x: np.ndarray, t: np.ndarray | None = None):
    return figures_of("log.csv", "x", Channel(np.arange(len(x)) / 500 if t is None else t, x))


def test_figures_of_a_noisy_channel():
    rng = np.random.default_rng(0)
    found = figures(np.sin(np.arange(5000) / 300) + 0.01 * rng.standard_normal(5000))
    assert found.rate == pytest.approx(500) and found.jitter < 1e-6 and found.gaps == 0
    assert found.noise == pytest.approx(0.01, rel=0.1)
    assert not found.dead and found.quantum == 0 and found.saturated == 0


def test_figures_of_faulty_channels():
    x = np.sin(np.arange(5000) / 300)
    assert figures(np.clip(x, -0.7, 0.7)).saturated > 0.2
    assert figures(np.round(x, 2)).quantum == pytest.approx(0.01)
    assert figures(np.ones(100)).dead
    t = np.delete(np.arange(5000) / 500, slice(1000, 2000))
    found = figures(np.delete(x, slice(1000, 2000)), t)
    assert found.gaps == 1 and found.longest == pytest.approx(2.002)
    rng = np.random.default_rng(0)
    assert figures(x, np.arange(5000) / 500 + rng.uniform(-5e-4, 5e-4, 5000)).jitter > 0.2


@pytest.mark.parametrize(
    "counts",
    [
        np.random.default_rng(0).integers(0, 400_000, 1_000_000),
        np.repeat(np.arange(500_000), 2),
        np.random.default_rng(1).integers(0, 5, 1_000_000),
    ],
    ids=["half as many levels as rows", "a slow ramp", "five levels"],
)
def test_the_step_of_a_long_channel_is_found(counts):
    assert quantum(0.001 * counts) == pytest.approx(0.001)
    assert quantum(0.001 * counts + np.linspace(0, 1, len(counts))) == 0


def test_a_channel_of_few_rows_has_no_figures():
    assert np.isnan(figures(np.array([1.0, np.nan])).rate)


def inspected(folder: Path, **changed: np.ndarray) -> Inspection:
    path = write_csv(folder / "log.csv", columns() | changed)
    return inspect(read_tables([path]), None, two_joints())


def test_a_clean_log_is_matched_without_alarm(tmp_path):
    found = inspected(tmp_path)
    assert found.recordings is not None
    assert [f.level for f in found.findings] == ["note"]  # the limits of rest
    assert {c.name: c.role for c in found.channels}["dq2"] == "v of elbow"


def test_what_identify_refuses_is_found(tmp_path):
    found = inspected(tmp_path, tau1=np.zeros(2000))
    assert ("refusal", "dead_channel") in [(f.level, f.code) for f in found.findings]


def test_channels_that_do_not_match_are_a_finding(tmp_path):
    found = inspected(tmp_path, current1=np.ones(2000), current2=np.ones(2000))
    assert found.recordings is None
    assert {f.code for f in found.findings} == {"unmatched", "dead_channel"}


def test_a_first_map_reads_the_log_as_matching_does(tmp_path):
    tables = read_tables([write_csv(tmp_path / "log.csv", columns())])
    (tmp_path / "map.toml").write_text(first_map(tables, two_joints()), encoding="utf-8")
    mapping = read_map(tmp_path / "map.toml")
    one = prepare(tables, mapping, two_joints())
    other = prepare(tables, None, two_joints())
    np.testing.assert_array_equal(one.segments[0].log.u, other.segments[0].log.u)


def test_a_first_map_offers_every_candidate(tmp_path):
    values = columns() | {"current1": columns()["tau1"], "current2": columns()["tau2"]}
    text = first_map(read_tables([write_csv(tmp_path / "log.csv", values)]), two_joints())
    assert '# command = { column = "current1" }  # choose one' in text
    chosen = text.replace('# command = { column = "tau', 'command = { column = "tau')
    (tmp_path / "map.toml").write_text(chosen, encoding="utf-8")
    found = read_map(tmp_path / "map.toml").joints["elbow"].command
    assert found is not None and found.column == "tau2"


def test_a_first_map_quotes_names_of_joints(tmp_path):
    names = ("arm/joint 1", "jöint.2")
    tables = read_tables([write_csv(tmp_path / "log.csv", columns())])
    (tmp_path / "map.toml").write_text(first_map(tables, two_joints(names)), encoding="utf-8")
    assert tuple(read_map(tmp_path / "map.toml").joints) == names


@pytest.mark.parametrize("extra", [{}, {"current1": np.ones(2000), "current2": np.ones(2000)}])
def test_signals_are_drawn_with_and_without_a_match(tmp_path, extra):
    titles = [section.title for section in inspection_page(inspected(tmp_path, **extra)).sections]
    assert titles == (["Channels over time", ""] if extra else [*SIGNALS, ""])


def test_rows_that_are_not_used_are_shaded_half_way_to_the_next():
    t = np.arange(5.0)
    assert _spans(t, np.array([True, False, True, True, False])) == [(0.0, 0.5), (1.5, 3.5)]
    assert _spans(t, np.array([False, False, False, False, True])) == [(3.5, 4.0)]
    assert _spans(t, np.zeros(5, bool)) == []


@pytest.mark.parametrize(("name", "position"), [("bluerov2", "qw"), ("f1tenth", "yaw")])
def test_channels_of_a_vehicle_have_the_names_of_its_signals(name: str, position: str):
    """Its positions and velocities are not named after its actuators."""
    robot = load_robot_model(name)
    names, system = signal_names(robot), robot.system
    assert [len(columns) for columns in names.values()] == [system.m, system.n, system.n_u]
    assert names["q"][-1][0] == position and names["v"][0] == ("surge", "m/s")


def test_the_command_writes_a_map_and_a_page(tmp_path, capsys):
    log = write_csv(tmp_path / "log.csv", {"t": columns()["t"], "x": columns()["q1"]})
    arguments = ["inspect", str(log), "--model", "tx40", "--out", str(tmp_path)]
    assert command(arguments) == 2
    printed = capsys.readouterr().out
    assert printed.startswith("✘ log.csv: Columns could not be matched") and "map.toml" in printed
    (tmp_path / "map.toml").write_text("edited", encoding="utf-8")
    (tmp_path / "inspection.html").write_bytes(b"the user's")
    assert command(arguments) == command(arguments) == 2
    assert (tmp_path / "inspection.html").read_bytes() == b"the user's"
    pages = {p.name for p in tmp_path.glob("*.html")}
    assert pages == {"inspection.html", "inspection-2.html"}
    assert (tmp_path / "map.toml").read_text(encoding="utf-8") == "edited"
    assert (tmp_path / "map-new.toml").is_file()


def test_the_command_says_as_json_what_identify_would_refuse(tmp_path, capsys):
    log = str(asset("tx40", "log.csv.gz"))
    arguments = ["inspect", log, "--model", "tx40", "--json", "--out", str(tmp_path)]
    assert command(arguments) == 2
    assert "degrees" in {f["code"] for f in json.loads(capsys.readouterr().out)["findings"]}
    mapped = [*arguments, "--map", str(asset("tx40", "map.toml"))]
    assert command(mapped) == 0
    assert not (tmp_path / "map-new.toml").exists()


def test_degrees_are_cured_as_the_remedy_says(tmp_path):
    values = columns()
    values |= {name: np.degrees(values[name]) for name in ("q1", "q2")}
    tables = read_tables([write_csv(tmp_path / "log.csv", values)])
    joints = {
        name: {
            "position": {"column": f"q{k}", "unit": "deg"},
            "velocity": {"column": f"dq{k}"},
            "command": {"column": f"tau{k}"},
        }
        for k, name in enumerate(("shoulder", "elbow"), 1)
    }
    recordings = prepare(tables, map_of({"joints": joints}), two_joints())
    assert checked(recordings, two_joints()).findings == recordings.findings


@pytest.mark.parametrize(
    ("vehicle", "lines"),
    [
        ("bluerov2", ['"thruster 8" = { column = "pwm8", ratio = 0.002, offset = -3 }  # -1 to 1']),
        (
            "hummingbird",
            [
                '"rotor 1" = { column = "pwm1", ratio = 0.001, offset = -1 }  # share of '
                "the top speed, 0 to 1; thrust is that of its square"
            ],
        ),
        (
            "remus100",
            [
                'u_5 = { column = "pwm5", ratio = 0.002, offset = -3 }  # share of the full '
                "speed, -1 to 1",
                'u_2 = { column = "pwm2" }  # deflection [rad]',
            ],
        ),
    ],
)
def test_the_first_map_of_a_vehicle_has_what_the_names_tell(vehicle, lines):
    robot = load_robot_model(vehicle)
    t = np.arange(0, 20, 0.02)
    names = ("x", "y", "z", "qx", "qy", "qz", "vel/x", "vel/y", "vel/z", "p", "q", "r")
    columns = {name: np.sin((0.1 + 0.05 * k) * t + k) / 2 for k, name in enumerate(names)}
    columns["qw"] = np.sqrt(1 - sum(columns[f"q{axis}"] ** 2 for axis in "xyz"))
    count = len(robot.joints)
    columns |= {f"pwm{k + 1}": 1500 + 200 * np.sin(t + k) for k in range(count)}
    made = LogTable("log.csv", {name: Channel(t, x) for name, x in columns.items()}, 0)
    assert [f.code for f in inspect([made], None, robot).findings][:1] == ["unmatched"]
    text = first_map([made], robot)
    assert "gear ratio" not in text and "a column for each actuator" in text
    for line in (*lines, 'position = ["x", "y", "z"]', 'linear = ["vel/x", "vel/y", "vel/z"]'):
        assert f"\n{line}\n" in text
    completed = map_of(tomllib.loads(text))
    assert inspect([made], completed, robot).recordings is not None


def test_the_first_map_of_a_vehicle_with_unknown_names_is_a_form():
    robot = load_robot_model("f1tenth")
    t = np.arange(0, 20, 0.02)
    made = LogTable("log.csv", {name: Channel(t, np.sin(t)) for name in ("a", "b")}, 0)
    text = first_map([made], robot)
    assert '# position = ["x", "y", "yaw"]' in text
    assert '# u_2 = { column = "…" }  # steering angle [rad]' in text
    assert tomllib.loads(text)["vehicle"] == {} == tomllib.loads(text)["actuators"]


@pytest.mark.parametrize("name", ["tx40", "so101"])
def test_a_packed_log_is_inspected_by_its_robots_name(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert command(["inspect", name, "--out", str(tmp_path)]) == 0
    assert ": nsaid identify can use this log." in capsys.readouterr().out
    assert (tmp_path / "map.toml").exists() == (name == "so101")  # the other has one


def test_fix_writes_a_map_with_which_the_log_is_accepted(tmp_path, capsys):
    values = columns()
    values |= {"dq1": np.degrees(values["dq1"]), "dq2": np.degrees(values["dq2"])}
    log = str(write_csv(tmp_path / "log.csv", values))
    model = tmp_path / "arm.urdf"
    model.write_text(URDF, encoding="utf-8")
    arguments = ["inspect", log, "--model", str(model), "--out", str(tmp_path)]
    assert command(arguments) == 2
    assert command([*arguments, "--fix"]) == 0
    printed = capsys.readouterr().out
    assert 'velocity = "deg/s"' in printed and "no contradiction is left" in printed
    assert command([*arguments, "--map", str(tmp_path / "map-fixed.toml")]) == 0


def test_joints_that_a_log_does_not_number_are_locked_as_the_message_says(tmp_path, capsys):
    """An arm's log has no columns of its gripper, and the next command still knows of it."""
    log = str(write_csv(tmp_path / "log.csv", columns()))
    model = tmp_path / "arm.urdf"
    finger = '<link name="f"/><joint name="finger" type="prismatic"><parent link="elbow_link"/>'
    finger += '<child link="f"/><axis xyz="1 0 0"/>'
    finger += '<limit lower="0" upper="0.04" effort="9" velocity="1"/></joint></robot>'
    model.write_text(URDF.replace("</robot>", finger), encoding="utf-8")
    arguments = ["inspect", log, "--model", str(model), "--out", str(tmp_path)]
    assert command(arguments) == 2
    assert "`--lock finger` holds these" in " ".join(capsys.readouterr().out.split())
    assert command([*arguments, "--lock", "finger"]) == 0
    assert f"identify {log} --model {model} --lock finger" in capsys.readouterr().out


def test_fix_is_withdrawn_if_another_contradiction_follows(tmp_path):
    """A remedy that makes the positions leave their limits is worse than the velocities' signs."""
    values = columns()
    path = write_csv(tmp_path / "log.csv", values | {"dq1": -values["dq1"]})
    tables = read_tables([path])
    robot = two_joints()
    before = inspect(tables, None, robot)
    found = fix([path], "", robot)
    assert found.kept and found.before.findings == before.findings
    worse = Finding("refusal", "x", "", "…", data={"map": {"factors.position": 1000.0}})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("nsaid_mj.clinic.identify.fixing.remedies", lambda _: worse.data["map"])
        found = fix([path], "", robot)
    assert not found.kept and found.text == "" and "contradiction follows" in found.withdrawn


def test_rates_and_accelerations_are_no_linear_velocity():
    """`ang_vel_x` ends like `vel_x`: a flight log's rates became its linear velocity."""
    robot = load_robot_model("hummingbird")
    t = np.arange(50.0)
    names = [f"q{k}" for k in range(4)]
    names += [f"{kind}_{axis}" for kind in ("ang_vel", "acc_b") for axis in "xyz"]
    names += ["vx", "vy", "vz", *(f"u{k}" for k in range(4))]
    made = LogTable("a.csv", {name: Channel(t, np.sin(t)) for name in names}, 0)
    vehicle = tomllib.loads(first_map([made], robot))["vehicle"]
    assert vehicle == {
        "quaternion": ["q0", "q1", "q2", "q3"],
        "order": "wxyz",
        "linear": ["vx", "vy", "vz"],
        "angular": ["ang_vel_x", "ang_vel_y", "ang_vel_z"],
        "acceleration": ["acc_b_x", "acc_b_y", "acc_b_z"],
    }
