"""Rerun recordings hold what was recorded."""

from __future__ import annotations

import gc
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
import rerun.blueprint as rrb
from rerun.error_utils import RerunWarning
from scipy.spatial.transform import Rotation

from nsaid_mj import (
    ArmPlant,
    Block,
    FourierTracking,
    Loss,
    NullspaceAID,
    ParameterSpace,
    Scenario,
)
from nsaid_mj.base.errors import NotWritten
from nsaid_mj.base.files import OutputFile, OutputFolder
from nsaid_mj.core.laws.faults import FaultEvent
from nsaid_mj.core.log import Log
from nsaid_mj.core.structure.columns.curve import LINEAR
from nsaid_mj.core.structure.joints import JointTree
from nsaid_mj.core.structure.parts import Body, Column, Inertia
from nsaid_mj.core.structure.structure import Structure
from nsaid_mj.core.structure.system import SecondOrderSystem
from nsaid_mj.lab.evaluation.labels import groups
from nsaid_mj.lab.evaluation.truth import Truth
from nsaid_mj.lab.loop import FAULTS, SimulatedRun, run
from nsaid_mj.lab.recording import forces, inertia, layout, torques, viewer
from nsaid_mj.lab.recording.run import write_run_recording
from nsaid_mj.report.page import Link, Page, Section, Table
from nsaid_mj.report.panels import Comparison, Panel, spread
from nsaid_mj.report.recording import lines, plots, scene
from nsaid_mj.report.recording.stream import write_recording as write_content
from nsaid_mj.report.recording.text import drawable
from nsaid_mj.report.result import Result
from tests.support.faulty import WITH_RIVAL as ROV
from tests.support.faulty import heard
from tests.support.fossen import published
from tests.support.recordings import VEHICLE, column, drawn_rows, entities_of, seconds
from tests.support.summaries import evaluated, summarize

ARM = Scenario(
    plant=ArmPlant(robot="ur5", damping=2.0, friction=1.0, armature=0.1),
    excitation=FourierTracking(fundamental=0.1, harmonics=5),
    identifier=NullspaceAID(K=20.0, gain=1.0),
    duration=0.3,
    pe_window=0.1,
    held_out=0.1,
)


def recorded(scenario: Scenario, folder: Path) -> SimulatedRun:
    result = run(scenario, folder)
    truth = Truth.of(result)
    write_run_recording(result, evaluated(result, truth), truth)
    return result


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> SimulatedRun:
    return recorded(ARM, tmp_path_factory.mktemp("arm"))


@pytest.fixture(scope="module")
def rov(tmp_path_factory: pytest.TempPathFactory) -> SimulatedRun:
    return recorded(ROV, tmp_path_factory.mktemp("rov"))


@pytest.fixture(scope="module")
def vehicle(tmp_path_factory: pytest.TempPathFactory) -> SimulatedRun:
    return recorded(VEHICLE, tmp_path_factory.mktemp("vehicle"))


def read(result: SimulatedRun) -> dict[str, dict[str, list]]:
    """Column name to values, by entity, over all of a recording's chunks."""
    return entities_of(result.folder / OutputFolder.RECORDING)


def test_the_recording_of_an_arm_has_every_entity(arm: SimulatedRun) -> None:
    entities = read(arm)
    for name in (
        "velocity_error",
        "distance/NS-AID",
        "log_distance/NS-AID",
        "theta_perp",
        "share",
        "lyapunov",
        "conserved",
        "log_conserved",
        "excitation/all",
        "excitation/perpendicular",
        "result",
        "estimate/motor_gain/estimated",
        "estimate/motor_gain/true_direction",
        "estimate/link_6/1/estimated",
        "statements",
        "unknown",
        "robot/torque/commanded",
        "robot/torque/estimated",
        "robot/links_of_theta/5/inertia/estimated",
        "robot/links_of_theta/5/inertia/reference",
        "robot/links_of_theta/5/centre_of_mass/estimated",
    ):
        assert f"/{name}" in entities
    meshes = [
        e for e in entities if e.startswith("/robot/") and "Mesh3D:vertex_positions" in entities[e]
    ]
    assert len(meshes) == len(arm.plant.visuals()) > 0
    assert all("Transform3D:translation" in entities[mesh] for mesh in meshes)


@pytest.mark.parametrize("which", ["arm", "rov", "vehicle"])
def test_the_last_estimate_is_bit_exact_and_the_timeline_ends_with_the_run(
    which: str, request: pytest.FixtureRequest
) -> None:
    result: SimulatedRun = request.getfixturevalue(which)
    entities, space = read(result), result.plant.system.space
    seen = set()
    for group in groups(space):
        columns = entities["/" + lines.path(*group.key, "estimated")]
        values = [v for v in columns["Scalars:scalars"] if v]
        assert values[-1] == result.record["theta_hat"][-1, group.indices].tolist()
        seen |= set(group.indices.tolist())
        times = [seconds(time) for time in columns["sim_time"] if time is not None]
        assert times[-1] == pytest.approx(result.record["t"][-1], abs=1e-9)
        assert times[-1] == pytest.approx(result.scenario.duration, abs=1e-9)
    assert seen == set(range(len(space)))


def test_recorded_distances_are_those_of_the_summary(rov: SimulatedRun) -> None:
    entities, summary = read(rov), summarize(rov, Truth.of(rov))
    for name, numbers in (("NS-AID", summary), ("conventional", summary["rivals"]["conventional"])):
        values = [v for v in entities[f"/distance/{name}"]["Scalars:scalars"] if v]
        assert values[0][0] == numbers["theta_perp_ratio_initial"]
        assert values[-1][0] == numbers["theta_perp_ratio"]
        assert f"/log_velocity_rms/{name}" in entities


def test_the_true_direction_has_the_estimates_mean_gain(vehicle: SimulatedRun) -> None:
    entities, space = read(vehicle), vehicle.plant.system.space
    truth, shown = vehicle.plant.truth, np.zeros(len(space))
    for group in groups(space):
        shown[group.indices] = entities["/" + lines.path(*group.key, "true_direction")][
            "Scalars:scalars"
        ][-1]
    ratio = vehicle.record["theta_hat"][-1, space.actuators] / shown[space.actuators]
    assert ratio.mean() == pytest.approx(1) and np.ptp(ratio) > 0.01
    np.testing.assert_allclose(shown, truth * shown[-1] / truth[-1], atol=1e-12)


@pytest.mark.parametrize("which", ["arm", "rov", "vehicle"])
def test_rerun_verifies_the_file_and_nothing_else_is_left(
    which: str, request: pytest.FixtureRequest
) -> None:
    result: SimulatedRun = request.getfixturevalue(which)
    file = result.folder / OutputFolder.RECORDING
    assert subprocess.call([*viewer.program(), "rrd", "verify", str(file)]) == 0
    assert [p.name for p in result.folder.glob(".*") if p.name != ".nsaid-mj.json"] == []


def test_series_have_names_with_units_that_the_viewer_can_draw(arm: SimulatedRun) -> None:
    for entity, columns in read(arm).items():
        for names in columns.get("SeriesLines:names", []):
            assert all(name == drawable(name) for name in names)
            plain = {"true direction", "95 % interval"}
            assert all(name.endswith("]") for name in names if name not in plain), entity
    assert "gain of elbow_joint [N·m/unit]" in names_of(arm)


def names_of(result: SimulatedRun) -> set[str]:
    """The names of all curves of a recording."""
    return {
        name
        for columns in read(result).values()
        for names in columns.get("SeriesLines:names", [])
        for name in names
    }


def test_no_name_or_text_has_a_stand_in_glyph(arm: SimulatedRun) -> None:
    texts = [read(arm)[f"/{name}"]["TextDocument:text"][0][0] for name in ("result", "statements")]
    for words in [*names_of(arm), *texts]:
        assert not {"?", "^"} & set(words), words
        assert "_perp" not in words


@pytest.mark.parametrize("background", [0.0, 1.0])
def test_every_colour_of_a_curve_is_readable_on_dark_and_on_light(background: float) -> None:
    for color in lines.PALETTE:
        part = np.array(color) / 255
        linear = np.where(part <= 0.04045, part / 12.92, ((part + 0.055) / 1.055) ** 2.4)
        luminance = linear @ [0.2126, 0.7152, 0.0722]
        low, high = sorted([luminance, background])
        assert (high + 0.05) / (low + 0.05) > 2.4, color


def test_legends_stand_beside_the_curves() -> None:
    t, none = np.zeros(0), np.zeros((0, 2))
    names = ["gain of a joint with a rather long name [N·m/A]", "x"]
    long = lines.Lines("a/b", names, t, none, [0, 1])
    short = lines.Lines("c", ["x [–]", "y [–]"], t, none, [0, 1])
    ends = []
    for entity in ("a", "c"):
        view = plots.Plots([long, short], 10.0)(entity, "title", 0.5)
        ends.append(view.properties["TimeAxis"].view_range.as_arrow_array().to_pylist()[0])
    until = [end["end"] * 1e-9 for end in ends]
    assert until[0] > until[1] > 10.5
    width = 0.5 * 1600 - 60
    assert (1 - 10 / until[0]) * width > 7 * len(long.names[0])  # space for the longest name


def test_plots_of_a_page_have_one_time_axis_and_comparisons_one_key() -> None:
    t = np.linspace(0.0, 10.0, 50)
    panel = Comparison("j", "u", "N", t, np.sin(t), np.cos(t), used=t < 8, key=("command", "j"))
    many = lines.Lines("many", ["a long name of a joint", "another"], t, np.ones((50, 2)), [0, 1])
    drawn = [*lines.lines_of([panel]), many]
    made = plots.Plots(drawn, 10.0)
    views = [made("many", "many"), made("command/j", "j")]
    page = made.grid(views, 1)
    ranges = [view.properties["TimeAxis"].view_range.as_arrow_array() for view in views]
    assert ranges[0] == ranges[1] and ranges[0].to_pylist()[0]["end"] > 11e9
    assert [one.origin for one in page.contents[:1]] == [f"/{plots.KEY}"]
    said = "measured: orange, wide; left out of the fit: red, wide; predicted: blue"
    assert lines.key(drawn) == said
    assert lines.key([many]) == ""


def test_a_line_that_is_drawn_over_another_is_thinner() -> None:
    """Rerun draws entities in the order of their names."""
    t = np.linspace(0.0, 1.0, 9)
    both = Panel("forces", "force [N]", key=("force",))
    both.add_columns(t, np.ones((9, 1)), ["x"], ("motion",))
    both.add_columns(t, np.ones((9, 1)), ["x"], ("actuators",), pale=True)
    one = Panel("speed", "speed [m/s]", key=("speed",))
    one.add_columns(t, np.ones((9, 1)), ["x"], ("a",))
    one.add_columns(t, np.ones((9, 1)), ["x"], ("b",))
    compared = Comparison("j", "u", "N", t, t, t, key=("command", "j"), target=t)
    found = lines.lines_of([both, one, compared])
    width = {line.path: line.width for line in found}
    assert width["force/actuators"] > width["force/motion"]
    assert width["speed/a"] == width["speed/b"]
    assert width["command/j/measured"] > width["command/j/predicted"]
    assert sorted(path for path in width if path.startswith("command"))[1:] == [
        "command/j/measured",
        "command/j/predicted",
    ]


def test_a_table_of_the_first_page_is_as_wide_as_its_view() -> None:
    heads = ["joint", "gain", "spare", "last column"]
    line = ("shoulder", ("1.0", Link("with a mass and many other parameters", "c")), "x" * 60, "y")
    shown = [
        Page("r", Result(), sections=[Section("", [table], brief=True)]).markdown()
        for table in (
            Table(heads, [line], spare=[2]),
            Table(heads, [("a" * 40, *line[1:])], spare=[2]),
        )
    ]
    assert "many other" not in shown[0] and "x" * 60 in shown[0]  # 88 letters have room
    assert "x" * 60 not in shown[1] and "last column" in shown[1]


def test_a_row_is_high_enough_for_its_longest_legend_and_a_curve_of_zeros_is_none() -> None:
    t, names = np.arange(2.0), [f"gain {i}" for i in range(12)]
    many = lines.Lines("gains", names, t, np.ones((2, 12)), range(12))
    one = lines.Lines("still", ["x"], t, np.zeros((2, 1)), [0])
    some = plots.Plots([many, one], 10.0)
    high, low = some("gains", "many"), some("still", "one")
    heights = some.heights([high, low], [low])
    assert 0.75 * (heights[0] - 30) > 12 * 23 and heights[1] == plots._ROOMY
    heights = some.heights([high], [high], [low])
    assert heights[2] < plots._ROOMY and sum(heights) < 1000
    assert some.moving("gains") and not some.moving("still")


def test_an_ellipsoid_has_the_inertia_that_it_is_drawn_for() -> None:
    rng = np.random.default_rng(1)
    half, mass = np.array([0.1, 0.2, 0.35]), 3.0
    centre = rng.normal(size=3)
    turn = Rotation.from_rotvec(rng.normal(size=3))
    about = (
        mass
        / 5
        * np.diag(
            [half[1] ** 2 + half[2] ** 2, half[0] ** 2 + half[2] ** 2, half[0] ** 2 + half[1] ** 2]
        )
    )
    full = turn.as_matrix() @ about @ turn.as_matrix().T
    full += mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    phi = np.array([mass, *(mass * centre), *full[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]])
    centres, halves, turns = inertia.ellipsoids(phi[None])
    np.testing.assert_allclose(centres[0], centre)
    np.testing.assert_allclose(np.sort(halves[0]), half)
    axes = Rotation.from_quat(turns[0]).as_matrix()
    np.testing.assert_allclose(np.abs(axes.T @ turn.as_matrix()), np.eye(3), atol=1e-9)


def test_torques_are_arcs_about_their_axes_as_long_as_the_torque_is_large(
    arm: SimulatedRun,
) -> None:
    assert isinstance(arm.system, JointTree)
    record, rows = arm.record, np.array([5, 60])
    some = Log.unchecked(*(record[name][rows] for name in Log._fields))
    torque = torques.joint_torques(arm.system, some, arm.plant.truth)
    np.testing.assert_allclose(
        torque, arm.plant.truth[arm.system.space.actuators] * some.u, rtol=1e-12
    )
    axis = np.array([0.0, 0.6, 0.8])
    arcs = torques._arcs(np.array([0.5, -1.0]), 0.2, axis)
    assert np.abs(arcs @ axis).max() < 1e-12
    start, end = arcs[:, 0], arcs[:, torques._POINTS - 1]
    turned = np.einsum("ki,i->k", np.cross(start, end), axis) / 0.2**2
    np.testing.assert_allclose(turned, np.sin([0.5, -1.0]))


def test_an_actuator_that_fails_is_red_from_then_on(tmp_path: Path) -> None:
    scenario = replace(
        ARM, plant=replace(ARM.plant, faults=(Loss(share=0.5, actuator=3, time=0.15),))
    )
    result = recorded(scenario, tmp_path)
    columns = read(result)["/robot/torque/estimated"]
    times = [seconds(t) for t in columns["sim_time"] if t is not None]
    colors = np.array([value for value in columns["LineStrips3D:colors"] if value is not None])
    red = colors == int.from_bytes(bytes([*forces.FAILED, 255]))
    assert (red[:, 2] == (np.array(times) >= 0.15)).all()
    assert not np.delete(red, 2, axis=1).any()


def test_a_minute_of_recording_is_below_20_MB(arm: SimulatedRun) -> None:
    """What grows with time grows from nothing: the file less its meshes, per second of motion."""
    entities = read(arm)
    frames = len([t for t in entities["/robot/torque/estimated"]["sim_time"] if t is not None])
    assert frames <= 15 * arm.scenario.duration + 2
    assert (arm.folder / OutputFolder.RECORDING).stat().st_size < 9e6  # meshes, mostly


def test_the_recorded_text_states_the_result(arm: SimulatedRun) -> None:
    text = read(arm)["/result"]["TextDocument:text"][0][0]
    assert "from the true set" in text and "57 of 84" in text
    assert "gain of wrist_3_joint" in read(arm)["/unknown"]["TextDocument:text"][0][0]
    assert text == drawable(text)


def test_a_robot_without_meshes_is_drawn_by_its_joints(tmp_path: Path) -> None:
    scenario = Scenario(plant=ArmPlant(robot="double_pendulum_simple"), duration=0.1, held_out=0.1)
    result = run(scenario, tmp_path)
    drawn = scene.Scene(result.system, result.plant)
    if result.plant.visuals():
        pytest.skip("it has meshes now")
    assert not drawn.empty
    truth = Truth.of(result)
    write_run_recording(result, evaluated(result, truth), truth)
    assert "LineStrips3D:strips" in read(result)["/robot/links"]


def test_a_sharp_edge_stays_sharp_and_a_flat_face_flat() -> None:
    corners = np.array(np.meshgrid([0.0, 1], [0.0, 1], [0.0])).reshape(3, 4).T
    vertices = np.vstack([corners, [[0, 0, 1], [1, 0, 1]]])
    triangles = np.array([[0, 2, 1], [1, 2, 3], [0, 1, 4]])
    _, faces, normals = scene.shaded(vertices, triangles)
    assert faces.shape == (3, 3)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1)
    np.testing.assert_allclose(np.abs(normals[:6, 2]), 1)
    np.testing.assert_allclose(normals[6:, 2], 0, atol=1e-12)


@pytest.mark.parametrize(("length", "most"), [(2, 4000), (4000, 4000), (4001, 4000), (60001, 4000)])
def test_decimation_keeps_both_ends(length: int, most: int) -> None:
    rows = spread(length, most)
    assert rows[0] == 0 and rows[-1] == length - 1 and len(rows) <= most + 1
    assert np.all(np.diff(rows) > 0)


def test_reruns_warnings_are_errors(tmp_path: Path) -> None:
    def draw(rec: rr.RecordingStream) -> None:
        rec.log("x", rr.Scalars("no number"))  # type: ignore[arg-type]

    with pytest.raises(RerunWarning):
        write_content(tmp_path / "test.rrd", "test", [rrb.Horizontal()], {}, (), draw)


@pytest.mark.parametrize("folder", ["missing", "."])
def test_a_recording_that_fails_says_nothing_on_stderr(folder: str, tmp_path: Path) -> None:
    """Rerun warns of data that its streams still hold when they end, or when the next one does."""

    def draw(rec: rr.RecordingStream) -> None:
        rec.log("x", rr.Scalars(1.0))
        if folder == ".":
            raise ZeroDivisionError

    with heard() as said:
        for _ in range(2):
            with pytest.raises(NotWritten if folder == "missing" else ZeroDivisionError):
                file = tmp_path / folder / "test.rrd"
                write_content(file, "test", [rrb.Horizontal()], {}, (), draw)
            gc.collect()
    assert said.err == ""


@pytest.mark.parametrize("which", ["arm", "rov", "vehicle"])
def test_every_view_has_one_parent_only(which: str, request: pytest.FixtureRequest) -> None:
    result: SimulatedRun = request.getfixturevalue(which)
    space, drawn = result.plant.system.space, scene.Scene(result.system, result.plant)
    camera = drawn.camera(result.record["q"], result.record["v"])
    curves = lines.lines_of(evaluated(result, Truth.of(result)).curves)
    for kind in ("motor gain", ""):
        pages = layout.pages_of_run(space, camera, plots.Plots(curves, 1.0), shared=kind)
        found, waiting = [], list(pages)
        while waiting:
            part = waiting.pop()
            found.append(part.id)  # Rerun complains of one that has two parents
            waiting += getattr(part, "contents", []) if hasattr(part, "kind") else []
        assert len(found) == len(set(found)) > 10


# -- vehicles ------------------------------------------------------------------------------------


def test_force_arrows_start_at_their_thrusters(vehicle: SimulatedRun) -> None:
    entities, record, space = read(vehicle), vehicle.record, vehicle.plant.system.space
    body = scene.BODY
    rows = drawn_rows(vehicle, entities, body)
    assert len(rows) > 50
    q, u = record["q"][rows], record["u"][rows]
    places = column(entities, body, "Transform3D:translation")[:, 0]
    attitudes = column(entities, body, "Transform3D:quaternion")[:, 0]
    np.testing.assert_allclose(np.hstack([places, attitudes]), q, atol=1e-6)

    # As MuJoCo has them: the published thrusters, each with its own true gain.
    thrusters, gains = (
        published(),
        vehicle.plant.truth[space["thruster gain"]],
    )
    powers = u[..., None] ** (2 * np.arange(len(thrusters.curve)) + 1)
    thrust = (powers @ thrusters.curve * gains)[..., None] * thrusters.directions
    assert (drawn_rows(vehicle, entities, forces.COMMANDED) == rows).all()
    origins = column(entities, forces.COMMANDED, "Arrows3D:origins")
    vectors = column(entities, forces.COMMANDED, "Arrows3D:vectors")
    assert origins.shape == vectors.shape == (len(rows), 8, 3)
    np.testing.assert_allclose(
        origins, np.broadcast_to(thrusters.positions, origins.shape), atol=1e-6
    )
    length = (vectors * thrust).sum() / (thrust**2).sum()
    assert length > 0
    np.testing.assert_allclose(vectors, length * thrust, atol=1e-5)
    longest = np.linalg.norm(vectors, axis=2).max(axis=1)
    assert 0.15 < np.sqrt(np.mean(longest**2)) < 0.4  # the vehicle is half a metre long

    # The estimated ones stand beside them, and differ by what the gains' shares are wrong.
    beside = column(entities, forces.ESTIMATED, "Arrows3D:origins") - origins
    assert 0 < np.linalg.norm(beside, axis=2).min() <= np.linalg.norm(beside, axis=2).max() < 0.05
    k = space["thruster gain"]
    share = record["theta_hat"][rows][:, k] / vehicle.plant.truth[k]
    share /= share.mean(axis=1, keepdims=True)
    assert np.abs(share - 1).max() > 0.05
    estimated = column(entities, forces.ESTIMATED, "Arrows3D:vectors")
    np.testing.assert_allclose(estimated, share[..., None] * vectors, atol=1e-5)


def test_an_arm_has_no_force_arrows_and_no_path(arm: SimulatedRun) -> None:
    assert not {f"/{forces.COMMANDED}", f"/{scene.PATH}"} & set(read(arm))


def test_the_force_arrow_of_a_heaving_vehicle_is_vertical(rov: SimulatedRun) -> None:
    entities = read(rov)
    rows = drawn_rows(rov, entities, forces.COMMANDED)
    vectors = column(entities, forces.COMMANDED, "Arrows3D:vectors")[:, 0]
    u = rov.record["u"][rows, 0]
    np.testing.assert_allclose(vectors, np.outer(u, [0, 0, vectors[-1, 2] / u[-1]]), atol=1e-6)
    heights = column(entities, scene.BODY, "Transform3D:translation")[:, 0]
    np.testing.assert_allclose(heights, np.outer(rov.record["q"][rows], [0, 0, 1]), atol=1e-6)


def test_the_path_goes_through_all_measured_positions(vehicle: SimulatedRun) -> None:
    entities = read(vehicle)
    rows = drawn_rows(vehicle, entities, scene.BODY)
    places = vehicle.record["q"][rows, :3]
    for way in (scene.PATH, scene.TRAIL):
        assert (drawn_rows(vehicle, entities, way) == rows[1:]).all()
        steps = column(entities, way, "LineStrips3D:strips")[:, 0]
        np.testing.assert_allclose(steps, np.stack([places[:-1], places[1:]], axis=1), atol=1e-6)


def test_meshes_of_a_vehicle_move_rigidly_as_in_mujoco(vehicle: SimulatedRun) -> None:
    entities, plant = read(vehicle), vehicle.plant
    q = vehicle.record["q"][-1:]
    translations, quaternions = plant.poses(q)
    R = scene.rotated(q[:, 3:], np.eye(3))[0].T
    meshes = sorted(e for e in entities if "Mesh3D:vertex_positions" in entities[e])
    assert len(meshes) == len(plant.visuals())
    for i, mesh in enumerate(meshes):
        place = column(entities, mesh[1:], "Transform3D:translation")
        turn = column(entities, mesh[1:], "Transform3D:quaternion")
        assert len(place) == len(turn) == 1  # once and for all
        np.testing.assert_allclose(q[0, :3] + R @ place[0, 0], translations[0, i], atol=1e-6)
        there = scene.rotated(turn[0], np.eye(3))[0].T
        world = scene.rotated(quaternions[:, i], np.eye(3))[0].T
        np.testing.assert_allclose(R @ there, world, atol=1e-6)


class Sled(SecondOrderSystem):
    """In the plane: a jet astern, one abeam, a torque, which has no place, and a weak fin."""

    def __init__(self) -> None:
        blocks = (
            Block("mass", ("m",), ("kg",), np.ones(1)),
            Block("jet", ("astern", "abeam", "torque"), ("N",) * 3, np.ones(3), actuator=True),
            Block("fin", ("lift", "drag"), ("N",) * 2, np.ones(2), actuator=True),
        )
        mounts = np.array([[-1.0, 0, 0], [0, 0.5, 0], [np.nan] * 3, [1, 0, 0], [1, 0, 0]])
        x, y = np.eye(3)[:2]
        weak = Column.polynomial(0.02 / 9)  # at the command 9
        columns = [
            Column("thruster", 1, body=0, input=0, point=-0.3 * y, direction=x),
            Column("thruster", 2, body=0, input=1, point=0.4 * x, direction=y),
            Column("rotor_torque", 3, body=0, input=2, direction=[0, 0, 1], curve=LINEAR),
            Column("thruster", 4, body=0, input=2, point=0 * x, direction=y, curve=weak),
            Column("thruster", 5, body=0, input=2, point=0 * x, direction=-x, curve=weak),
        ]
        mass = Inertia.tied([(0, 0, 0, 1.0), (1, 1, 0, 1.0), (5, 5, 0, 1.0)])
        structure = Structure([Body("planar")], [mass], columns, 6, 3)
        super().__init__(structure, ParameterSpace(blocks), mounts)

    def random_state(self, rng: np.random.Generator):
        return np.zeros(3), np.zeros(3), rng.uniform(-1, 1, 3)


def test_planar_forces_lie_in_the_plane_and_small_ones_are_magnified(tmp_path: Path) -> None:
    u = np.array([[1.0, 2, 9], [-1.0, -2, 9]])
    rows = Log(np.array([0.0, 1]), np.zeros((2, 3)), np.zeros((2, 3)), u)
    theta = np.array([1.0, 3, 4, 5, 6, 7])
    arrows = forces.Arrows(Sled(), 2.0, rows, theta)
    assert [p.tolist() for p in arrows.parts] == [[1], [2], [4, 5]]
    # 8 N over 0.02·‖(6, 7)‖ N, so that fins are drawn 43 times as long at most
    assert arrows.magnified == {"fin": 20.0}
    assert arrows.lengths[:, 0].tolist() == [arrows.lengths[0, 0] * n for n in (1, 1, 20)]
    file = tmp_path / "sled.rrd"
    rec = rr.RecordingStream("nsaid_mj test")
    rec.save(file)
    arrows.log_style(rec, forces.COMMANDED)
    arrows.log(rec, forces.COMMANDED, rows, theta)
    rec.disconnect()
    entities = entities_of(file)
    vectors = column(entities, forces.COMMANDED, "Arrows3D:vectors")
    fin = [-0.14, 0.12, 0]
    expected = np.array([[[3.0, 0, 0], [0, 8, 0], fin], [[-3.0, 0, 0], [0, -8, 0], fin]])
    np.testing.assert_allclose(vectors, arrows.lengths * expected, rtol=1e-6)
    up = 2.5 * arrows.radius  # they lie on the ground
    origins = column(entities, forces.COMMANDED, "Arrows3D:origins")
    np.testing.assert_allclose(origins[0, 0] + vectors[0, 0], [-1, 0, up], atol=1e-6)  # inwards
    np.testing.assert_allclose(origins[0, 1], [0, 0.5, up], atol=1e-6)
    np.testing.assert_allclose(origins[1, 0], [-1, 0, up], atol=1e-6)
    np.testing.assert_allclose(origins[1, 1] + vectors[1, 1], [0, 0.5, up], atol=1e-6)  # inwards
    across = np.einsum("ja,ja->j", arrows.offsets, [[1.0, 0, 0], [0, 1, 0], fin])
    np.testing.assert_allclose(across, 0, atol=1e-12)


def test_a_bodys_velocities_have_their_names(vehicle: SimulatedRun, arm: SimulatedRun) -> None:
    assert vehicle.system.velocity_names[:4:3] == ["surge [m/s]", "roll rate [rad/s]"]
    assert vehicle.system.velocity_names[5] == "yaw rate [rad/s]"
    assert arm.system.velocity_names[0] == "shoulder_pan_joint [rad/s]"


def test_a_large_block_has_a_page_of_its_own(vehicle: SimulatedRun, arm: SimulatedRun) -> None:
    def names(result: SimulatedRun) -> list[object]:
        return [page.name for page in layout.estimates(result.plant.system.space, plots.Plots())]

    assert names(vehicle) == ["Estimate", "Mass matrix"]
    assert names(arm) == ["Estimate", "Link 1 – 3", "Link 4 – 6"]


def test_the_link_of_a_failed_joint_turns_red_when_that_is_found(tmp_path: Path) -> None:
    result = run(ARM, tmp_path)
    event = FaultEvent(0.1, 0.12, "loss", "gain", ("gain_3",), 0.4, 0.3, 0.5, "1", 1.0)
    OutputFile(tmp_path / FAULTS).write_json([event.keys()])
    truth = Truth.of(result)
    write_run_recording(result, evaluated(result, truth), truth)
    mesh = "Mesh3D:albedo_factor"
    parts = {name: part for name, part in read(result).items() if mesh in part}
    red = int.from_bytes(bytes([224, 49, 49, 255]))
    for name, part in parts.items():
        colours = [value[0] for value in part[mesh] if value is not None]
        if "forearm" in name:  # a static colour would hide the later one
            times = [seconds(t) for t in part["sim_time"] if t is not None]
            assert 0.0 in times and times.count(0.12) == 1
            assert len(colours) == 2 and colours[-1] == red
        else:
            assert red not in colours
    assert any("forearm" in name for name in parts)
