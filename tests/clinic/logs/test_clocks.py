"""Times in s, ms, µs, ns, since 1970 or since start, and as dates, become the same seconds."""

import numpy as np
import pytest

from nsaid_mj.clinic.logs import clocks
from nsaid_mj.clinic.logs.tables import read as read_table

T = np.cumsum(np.r_[0.0, 0.002 + 1e-4 * np.sin(np.arange(500))])
EPOCH = 1_700_000_000


@pytest.mark.parametrize("unit,scale", [("s", 1.0), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
@pytest.mark.parametrize("origin", [0, EPOCH])
def test_units_of_time_are_detected(unit, scale, origin):
    whole = np.round((T + origin) * 1e9).astype(np.int64)
    column = whole if unit == "ns" else whole / (1e9 / scale)
    clock = clocks.read(column, "t", None)
    assert clock is not None and clock.unit == unit
    np.testing.assert_allclose(clock.t, T, atol=1e-6)
    assert abs(clock.origin - origin * 1_000_000_000) < 1000


@pytest.mark.parametrize("name,unit", [("time_ms", "ms"), ("t [us]", "us"), ("stamp (ns)", "ns")])
def test_a_unit_in_the_name_decides(name, unit):
    clock = clocks.read(np.arange(10), name, None)
    assert clock is not None and clock.unit == unit and not clock.guessed


@pytest.mark.parametrize(
    "texts",
    [
        ["2026-01-02 03:04:05.000", "2026-01-02 03:04:05.010", "2026-01-02 03:04:05.020"],
        ["2026-01-02T03:04:05.000Z", "2026-01-02T03:04:05.010Z", "2026-01-02T03:04:05.020Z"],
        ["03:04:05.000", "03:04:05.010", "03:04:05.020"],
    ],
)
def test_dates_are_read(texts):
    clock = clocks.read(np.array(texts, dtype=object), "time", None)
    assert clock is not None and clock.unit == "date"
    np.testing.assert_allclose(clock.t, [0, 0.01, 0.02], atol=1e-9)


def test_texts_that_are_no_dates_are_no_clock():
    assert clocks.read(np.array(["a", "b"], dtype=object), "time", None) is None


@pytest.mark.parametrize("name", ["t", "Time", "timestamp", "header.stamp", "t_s", "time [ms]"])
def test_the_time_is_found_by_name(name):
    steps = np.arange(10.0)
    assert clocks.time_column({"q": -steps, "i": steps, name: steps}) == name


def test_the_time_is_found_as_a_first_column_that_increases():
    steps = np.arange(10.0)
    assert clocks.time_column({"column_1": steps, "column_2": steps**2}) == "column_1"
    assert clocks.time_column({"column_1": np.sin(steps), "column_2": steps}) is None


@pytest.mark.parametrize(
    ("seconds", "nanoseconds"),
    [
        ("header.stamp.sec", "header.stamp.nanosec"),
        ("stamp_secs", "stamp_nsecs"),
        ("sec", "nsec"),
        ("t_s", "t_ns"),
    ],
)
def test_a_stamp_in_two_columns_is_one_time(tmp_path, seconds, nanoseconds):
    whole = 1_700_000_000_900_000_000 + 50_000_000 * np.arange(20)
    rows = [f"{x // 10**9},{x % 10**9},{k}" for k, x in enumerate(whole.tolist())]
    path = tmp_path / "log.csv"
    path.write_text("\n".join([f"{seconds},{nanoseconds},q1", *rows]), encoding="utf-8")
    table = read_table(path)
    assert list(table.channels) == ["q1"] and table.origin == whole[0]
    np.testing.assert_allclose(table.channels["q1"].t, 0.05 * np.arange(20), atol=1e-9)


def test_columns_that_only_look_like_a_stamp_in_two_parts_stay(tmp_path):
    path = tmp_path / "log.csv"
    rows = [f"{0.01 * k:.2f},{k * 7_000_000_000},{k}" for k in range(20)]
    path.write_text("\n".join(["t_s,t_ns,q1", *rows]), encoding="utf-8")
    assert set(read_table(path).channels) == {"t_ns", "q1"}


def test_times_that_no_clock_reaches_are_missing():
    assert clocks.read(np.full(3, 1e300), "t", None) is None
    clock = clocks.read(np.array([1e300, 0.5, 0.6, 0.7]), "t", None)
    assert clock is not None
    np.testing.assert_allclose(clock.t, [np.nan, 0.0, 0.1, 0.2])
