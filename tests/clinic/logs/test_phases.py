"""Parts of a log in which no structure can hold are left out and told; all others are kept."""

import numpy as np
import pytest

from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.clinic.logs.mapping import Map, Phases
from nsaid_mj.clinic.logs.phases import events_of
from nsaid_mj.clinic.logs.preparation import prepare
from nsaid_mj.clinic.logs.recordings import Recordings
from nsaid_mj.clinic.logs.tables import Channel, LogTable
from nsaid_mj.clinic.logs.unusable import UnusableLog
from tests.court.field_phases import draw
from tests.support.robot_logs import columns, two_joints

LATE = 0.2  # of phases found from signals [s]


def left_out(recordings: Recordings) -> list[tuple[str, float, float]]:
    parts = [phase for phase in recordings.phases if not phase.used]
    return [(p.kind, float(p.log.t[0]), float(p.log.t[-1])) for p in parts]


def read(drawn, mapping: Map | None = None) -> Recordings:
    from nsaid_mj.clinic.logs.tables import read_tables

    return prepare(read_tables([drawn.log]), mapping, load_robot_model(drawn.model))


@pytest.mark.parametrize(
    ("kind", "model", "found"),
    [
        ("ground", "crazyflie", {"at rest"}),
        ("ground", "f1tenth", {"at rest"}),  # whose tyres slip by the ratio of two noises
        ("spinning", "hummingbird", {"at rest", "held"}),
        ("carried", "crazyflie", {"at rest", "carried"}),
        ("twice", "bluerov2", {"at rest"}),
        ("crash", "crazyflie", {"at rest", "held", "after an impact"}),
    ],
)
def test_a_vehicle_on_the_ground_is_left_out(kind, model, found, tmp_path):
    drawn = draw(5, tmp_path, kind, model)
    recordings = read(drawn)
    parts = left_out(recordings)
    assert {name for name, *_ in parts} <= found and parts
    ((start, end),) = drawn.out
    assert parts[0][1] == pytest.approx(start, abs=0.3)
    assert parts[-1][2] == pytest.approx(end, abs=LATE)
    (finding,) = [f for f in recordings.findings if f.code == "phases"]
    assert finding.data["used"] == pytest.approx(drawn.total - (end - start), abs=0.5)
    if kind == "ground" and model == "crazyflie":  # motors that are off are not at a limit
        assert not any(f.code == "saturated" and "%" in f.text for f in recordings.findings)


@pytest.mark.parametrize("kind", ["healthy", "gentle"])
@pytest.mark.parametrize("model", ["hummingbird", "bluerov2"])
def test_a_robot_that_flies_or_creeps_is_not_at_rest(kind, model, tmp_path):
    assert left_out(read(draw(6, tmp_path, kind, model))) == []


def test_the_log_s_own_words_come_first(tmp_path):
    drawn = draw(7, tmp_path, "armed column", "crazyflie")
    ((kind, start, end),) = left_out(read(drawn))
    assert (kind, start) == ("disarmed", 0.0)
    assert end == pytest.approx(drawn.out[0][1], abs=0.1)


def test_a_map_can_say_more_or_switch_the_search_off(tmp_path):
    drawn = draw(8, tmp_path, "ground", "crazyflie")
    assert left_out(read(drawn, Map(phases=Phases(detect=False)))) == []
    ((kind, start, end),) = left_out(
        read(drawn, Map(phases=Phases(detect=False, leave_out=((2.0, 3.0),))))
    )
    assert (kind, start) == ("left out", 2.0) and end == pytest.approx(3.0, abs=0.1)


def channel(t: list[float], x: list[float]) -> Channel:
    return Channel(np.array(t), np.array(x))


def spans(channels: dict[str, Channel], stated: Phases | None = None) -> list[tuple]:
    return [(e.kind, e.start, e.end) for e in events_of(channels, stated or Phases())]


@pytest.mark.parametrize(
    ("name", "values", "kind"),
    [
        ("vehicle_status/arming_state", [1, 2, 1], "disarmed"),
        ("vehicle_land_detected/landed", [1, 0, 1], "landed"),
        ("robot/is_armed", [0, 1, 0], "disarmed"),
        ("torque_enable", [0, 1, 0], "disarmed"),
        ("EV/Id", [15, 10, 11], "disarmed"),
        ("EV/Id", [15, 28, 17], "landed"),
        ("EV/Id", [57, 55, 54], "disarmed"),
        ("actuator_armed/kill", [1, 0, 1], "disarmed"),
        ("vehicle_land_detected/ground_contact", [1, 0, 1], "landed"),
    ],
)
def test_events_of_flight_controllers(name, values, kind):
    found = spans({name: channel([0.0, 5.0, 60.0], values)})
    assert found[:2] == [(kind, -np.inf, 5.0), (kind, 60.0, np.inf)]


@pytest.mark.parametrize(
    ("first", "spans_of"), [(0, [(5.0, np.inf)]), (1, [(-np.inf, 5.0)])], ids=["disarms", "arms"]
)
def test_before_a_controller_s_first_change_the_opposite_held(first, spans_of):
    """ArduSub logs from arming on: all of such a log counted as disarmed."""
    found = spans({"ARM/ArmState": channel([5.0], [first])})
    assert found == [("disarmed", *span) for span in spans_of]


def test_a_crash_that_a_flight_controller_finds_ends_the_flight():
    when = [0.0, 5.0, 60.0]
    said = {"ERR/Subsys": channel(when, [2, 12, 12]), "ERR/ECode": channel(when, [1, 1, 0])}
    assert spans(said) == [("after an impact", 5.0, 60.0)]
    del said["ERR/ECode"]
    assert spans(said) == []


@pytest.mark.parametrize(
    ("name", "actuator", "modes"),
    [
        ("MODE/ModeNum", "rotor", ["Stabilize", "Land", "40"]),
        ("MODE/Mode", "thruster", ["Stabilize", "Surface", "40"]),
        ("MODE/ModeNum", "", ["0", "9", "40"]),  # of a rover, whose modes have other numbers
        ("vehicle_status/nav_state", "rotor", ["Manual", "9", "40"]),
        ("pilot/flight_mode", "rotor", ["0", "9", "40"]),
    ],
)
def test_modes_are_shown_by_name_and_leave_nothing_out(name, actuator, modes):
    channels = {name: channel([0.0, 5.0, 60.0], [0, 9, 40])}
    found = events_of(channels, Phases(), actuator)
    assert [(e.kind, e.name) for e in found] == [("mode", x) for x in modes]
    assert [e.start for e in found] == [-np.inf, 5.0, 60.0]


def test_a_column_of_many_values_is_no_mode():
    assert spans({"a/mode": channel([0.0, 1.0], [0.0, 0.5])}) == []
    t = np.arange(100.0)
    assert spans({"a/mode": Channel(t, t)}) == []


def test_modes_of_a_flight_are_a_note_and_in_every_phase(tmp_path):
    from dataclasses import replace

    from nsaid_mj.clinic.logs.tables import read_tables

    drawn = draw(7, tmp_path, "armed column", "crazyflie")
    (table,) = read_tables([drawn.log])
    t = next(iter(table.channels.values())).t
    end = float(t[-1])
    mode = Channel(t, (t > end / 2).astype(float))
    table = replace(table, channels=table.channels | {"pilot_mode": mode})
    robot = load_robot_model(drawn.model)
    stated = Map(phases=Phases(mode="pilot_mode"))
    found = prepare([table], stated, robot)
    (note,) = [finding for finding in found.findings if finding.code == "modes"]
    assert note.level == "note" and [x["mode"] for x in note.data["modes"]] == ["0", "1"]
    assert note.data["modes"][1]["span"][0] == pytest.approx(end / 2, abs=0.02)
    assert [phase.kind for phase in found.phases] == ["disarmed", "airborne"]
    *_, words = found.phases[1].row
    assert words == "used (mode 0, 1)"
    plain = prepare(read_tables([drawn.log]), None, robot)
    np.testing.assert_array_equal(found.segments[0].log.v, plain.segments[0].log.v)


def test_columns_of_a_map_are_events():
    channels = {"motors": channel([0.0, 4.0], [0, 1]), "ground": channel([0.0, 5.0], [1, 0])}
    stated = Phases(armed="motors", landed="ground")
    assert spans(channels, stated) == [("disarmed", -np.inf, 4.0), ("landed", -np.inf, 5.0)]


def test_an_arm_is_cut_where_its_log_says_that_it_is_disarmed():
    values = columns()
    values["armed"] = (np.abs(values["t"] - 5) > 1).astype(float)
    channels = {name: Channel(values["t"], x) for name, x in values.items() if name != "t"}
    found = prepare([LogTable("log.csv", channels, 0)], None, two_joints())
    ((kind, start, end),) = left_out(found)
    assert kind == "disarmed" and len(found.segments) == 2
    assert (start, end) == (pytest.approx(4.0, abs=0.11), pytest.approx(6.0, abs=0.11))


def test_a_log_that_is_all_rest_is_refused_with_its_phase(tmp_path):
    drawn = draw(9, tmp_path, "armed column", "crazyflie")
    lines = drawn.log.read_text().splitlines()
    drawn.log.write_text("\n".join(lines[: int(100 * drawn.out[0][1])]))
    with pytest.raises(UnusableLog) as caught:
        read(drawn)
    assert "phases" in {finding.code for finding in caught.value.findings}
    assert "left out: disarmed" in str(caught.value)


def test_short_episodes_count_together_and_what_is_too_short_is_counted():
    values = columns()
    tables = []
    for k, first in enumerate(range(0, 1900, 100)):
        rows = slice(first, first + (80 if k % 5 else 20))  # 0.4 s and 0.1 s
        own = {n: Channel(values["t"][rows], x[rows]) for n, x in values.items() if n != "t"}
        tables.append(LogTable(f"episode_{k}", own, 0))
    found = prepare(tables, Map(drop_rest=False), two_joints())
    assert len(found.segments) == 15
    (finding,) = [f for f in found.findings if f.code == "short_stretch"]
    assert finding.data["count"] == 4 and "4 of 19" in finding.text


def test_a_flight_out_of_the_hand_is_not_carried(tmp_path):
    """Nothing lay still between both: the whole flight counted as carried."""
    drawn = draw(5, tmp_path, "carried", "crazyflie")
    ((_, end),) = drawn.out
    head, *lines = drawn.log.read_text().splitlines()
    t = np.array([float(line.split(",")[0]) for line in lines])
    still = (t > end - 2.2) & (t < end + 1.5)  # it is put down, lies, and takes off gently
    kept = [line for line, lies in zip(lines, still, strict=True) if not lies]
    step = t[1] - t[0]
    stamped = [f"{k * step:.6g},{line.partition(',')[2]}" for k, line in enumerate(kept)]
    drawn.log.write_text("\n".join([head, *stamped]))
    parts = left_out(read(drawn))
    assert parts[-1][0] == "carried"
    assert end - 2.2 <= parts[-1][2] < end - 1.2
