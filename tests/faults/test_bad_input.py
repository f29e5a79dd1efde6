"""Bad input raises a typed error before the first step: expected, received, remedy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from nsaid_mj import ConventionalAID, FourierTracking, NsaidError, NullspaceAID, Scenario
from nsaid_mj.base.errors import BadRun, InvalidInput, UnknownName
from nsaid_mj.core.laws.base import State, Status
from nsaid_mj.core.laws.nullspace_aid import NullspaceIdentifier, paper_identifier
from nsaid_mj.core.log import Measurement
from nsaid_mj.lab.loop import run
from nsaid_mj.lab.postprocessing import rebuild
from nsaid_mj.lab.record import Record
from nsaid_mj.robots.assets import scenarios
from nsaid_mj.robots.errors import BadRobot
from tests.campaign import fields
from tests.support.faulty import PENDULUM, ROV, flat, shell

# -- on the command line -------------------------------------------------------------------------

WORDS = {  # what is typed: expected, got, remedy
    "scalar_rov --dt nan": ("dt: expected a finite number", "got nan", "default is 0.001"),
    "scalar_rov --dt 0": ("dt: expected a number greater than", "got 0", "default is 0.001"),
    "scalar_rov --duration inf": ("a finite number", "got inf", "default is 60"),
    "scalar_rov --duration 1e300": ("less than or equal to", "got 1e+300", "default is 60"),
    "scalar_rov --duration 1e14": ("at most 1e+09 steps of 0.01 s", "got 1", "Make it shorter"),
    "scalar_rov --duration -1": ("a number greater than 0", "got -1", "default is 60"),
    "scalar_rov --duration 0.01": ("at least two steps", "got 0.01", "longer"),
    "scalar_rov --held-out 0": ("a number greater than 0", "got 0", "default is 5"),
    "scalar_rov --held-out 1e6": ("at most 1e+06 steps", "got 1000000", "Make it shorter"),
    "scalar_rov --pe-window nan": ("a finite number", "got nan", "default is 2"),
    "scalar_rov --initial-error -1": ("greater than or equal to 0", "got -1", "default is 0.3"),
    "scalar_rov --gain-error 2": ("a number less than 1", "got 2", "default is None"),
    "scalar_rov --record-every 0": ("greater than or equal to 1", "got 0", "default is 1"),
    "scalar_rov --seed -1": ("greater than or equal to 0", "got -1", "default is 0"),
    "scalar_rov --noise.position nan": (
        "noise.position: expected a finite number",
        "got nan",
        "default is 0.0001",
    ),
    "scalar_rov --plant.mass -3": (
        "plant.mass: expected a number greater than 0",
        "got -3",
        "default is 32.18",
    ),
    "scalar_rov --plant.spread 1": ("a number less than 1", "got 1", "default is 0.2"),
    "scalar_rov --amplitude nan": ("a finite number", "got nan", "default is 0.8"),
    "scalar_rov --amplitude inf": ("a finite number", "got inf", "default is 0.8"),
    "scalar_rov --amplitude 0": ("a number greater than 0", "got 0", "default is 0.8"),
    "scalar_rov --low 2 --high 1": ("0 < low < high", "2.0 … 1.0", "0.05 … 0.5 Hz"),
    "scalar_rov --tones 0": ("greater than or equal to 1", "got 0", "default is 8"),
    "scalar_rov --tones 100000000": ("less than or equal to 1000", "got 100000000", "is 8"),
    "scalar_rov --identifier.K 300": ("λ_max(K)·dt ≤ 2.5", "300/s · 0.01 s = 3", "K ≤ 250/s"),
    "scalar_rov --identifier.K nan": (
        "identifier.K: expected a finite number",
        "got nan",
        "default is 20",
    ),
    "scalar_rov --identifier.K -1": ("a number greater than 0", "got -1", "default is 20"),
    "scalar_rov --identifier.gain 0": ("a number greater than 0", "got 0", "default is 1"),
    "scalar_rov --identifier.gain inf": ("a finite number", "got inf", "default is 1"),
    "ur5 --identifier.gain -2": ("a number greater than 0", "got -2", "default is 1"),
    "ur5 --reach 2": ("less than or equal to 1", "got 2", "default is 0.8"),
    "ur5 --bandwidth nan": ("a finite number", "got nan", "default is 2"),
    "ur5 --fundamental 0": ("a number greater than 0", "got 0", "default is 0.1"),
    "ur5 --harmonics 0": ("greater than or equal to 1", "got 0", "default is 5"),
    "ur5 --friction 0": ("a number greater than 0", "got 0", "default is None"),
    "ur5 --dt 0.05": ("joint", "too fast for steps of 0.05 s", "Use dt ≤"),
    "arm --robot ur55": ("unknown robot: 'ur55'", "Did you mean", "ending in .urdf"),
    "arm --robot no/such.urdf": ("no/such.urdf", "no such file", "Give the path"),
    "arm --robot weightless.urdf": ("link of joint", "its mass is 0 kg", "Give it an <inertial>"),
    "arm --robot impossible.urdf": ("link of joint j1", "no body has", "Correct <inertia>"),
    "arm --robot sentence.urdf": ("sentence.urdf", "it is not XML", "Correct the file"),
    "scalar_rv": ("unknown scenario: 'scalar_rv'", "Did you mean scalar_rov", "by its path"),
    "sentence.urdf": ("unknown scenario: 'sentence.urdf'", "Known:", "by its path"),
    "empty.py": ("defines `scenario = Scenario(…)`", "got none", "See scenarios/"),
}

LINK = """<link name="l1"><inertial><mass value="1"/><origin xyz="0.1 0 0"/>
<inertia ixx="{}" iyy="{}" izz="{}" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
URDF = """<robot name="r"><link name="base"/>{}
<joint name="j1" type="revolute"><parent link="base"/><child link="l1"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with broken files, to run in."""
    (tmp_path / "weightless.urdf").write_text(URDF.format('<link name="l1"/>'))
    (tmp_path / "impossible.urdf").write_text(URDF.format(LINK.format(1, 1, 5)))
    (tmp_path / "possible.urdf").write_text(URDF.format(LINK.format(0.1, 0.1, 0.1)))
    (tmp_path / "sentence.urdf").write_text("this is no robot")
    (tmp_path / "empty.py").write_text('"""Nothing here."""\n')
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("typed", WORDS)
def test_a_bad_command_says_what_was_expected_what_came_and_the_remedy(
    typed: str, desk: Path
) -> None:
    before = sorted(desk.rglob("*"))
    code, said = shell("run", *typed.split(), "--out", "out", "--quiet")
    message = flat(said.err)
    assert code == 2
    for words in WORDS[typed]:
        assert words in message
    assert "Traceback" not in message and said.out == ""
    assert sorted(desk.rglob("*")) == before


def test_the_urdf_behind_the_broken_ones_is_valid(desk: Path) -> None:
    code, said = shell(
        "run",
        "arm",
        "--robot",
        "possible.urdf",
        "--duration",
        0.05,
        "--held-out",
        0.05,
        "--quiet",
        "--out",
        "out",
    )
    assert (code, said.err) == (0, "")


@pytest.mark.parametrize(
    "typed", ["view nowhere", "view .", "view empty.py/run", "view . --rebuild"]
)
def test_viewing_a_folder_that_is_no_run_is_refused(typed: str, desk: Path) -> None:
    before = sorted(desk.rglob("*"))
    code, said = shell(*typed.split())
    assert code == 2
    assert said.err.startswith("nsaid: ") and "Give the folder" in said.err
    assert sorted(desk.rglob("*")) == before


# -- in Python -----------------------------------------------------------------------------------

NAN, INF = float("nan"), float("inf")
THETA = np.ones(4)  # of the vehicle
FIRST = Measurement(0.0, np.zeros(1), np.zeros(1), np.zeros(1))
NEXT = Measurement(0.01, np.zeros(1), np.zeros(1), np.zeros(1))


@cache
def rov() -> Any:
    """The vehicle's structure."""
    return ROV.plant.build(ROV.dt, 0).system


@cache
def arm() -> Any:
    """The pendulum's structure; built where it is needed, since it compiles."""
    return PENDULUM.plant.build(PENDULUM.dt, 0).system


def law(system=None, K=None, Gamma=None, prior=None, dt=0.01) -> NullspaceIdentifier:
    system = system or rov()
    return paper_identifier(
        system,
        np.ones(system.n) if K is None else np.asarray(K),
        system.space.scale**2 if Gamma is None else np.asarray(Gamma),
        np.ones(system.p) if prior is None else np.asarray(prior),
        dt,
    )


def follow(following: Measurement) -> State:
    one = law(prior=THETA)
    return one.step(one.init(FIRST), FIRST, following)


def crossed(size: int, value: float) -> np.ndarray:
    """The identity with one pair of entries off the diagonal."""
    matrix = np.eye(size)
    matrix[0, 1] = matrix[1, 0] = value
    return matrix


def lopsided(size: int) -> np.ndarray:
    matrix = np.eye(size)
    matrix[0, 1] = 0.1
    return matrix


BAD: dict[str, tuple[str, Callable[[], object]]] = {
    "Γ too short": ("Gamma", lambda: law(Gamma=np.ones(3))),
    "Γ not square": ("Gamma", lambda: law(Gamma=np.ones((4, 3)))),
    "Γ a number": ("Gamma", lambda: law(Gamma=1.0)),
    "Γ with a NaN": ("Gamma", lambda: law(Gamma=[1, 1, NAN, 1])),
    "Γ infinite": ("Gamma", lambda: law(Gamma=[1, 1, INF, 1])),
    "Γ with a zero": ("Gamma", lambda: law(Gamma=[1, 1, 0, 1])),
    "Γ negative": ("Gamma", lambda: law(Gamma=[1, 1, -1, 1])),
    "Γ indefinite": ("Gamma", lambda: law(Gamma=crossed(4, 1.5))),
    "Γ singular": ("Gamma", lambda: law(Gamma=np.diag([1, 1, 0, 1]))),
    "Γ not symmetric": ("Gamma", lambda: law(Gamma=lopsided(4))),
    "K too long": ("K", lambda: law(K=np.ones(2))),
    "K with a NaN": ("K", lambda: law(K=[NAN])),
    "K zero": ("K", lambda: law(K=[0.0])),
    "K indefinite": ("K", lambda: law(arm(), K=crossed(2, 1.5))),
    "K not symmetric": ("K", lambda: law(arm(), K=lopsided(2))),
    "K too fast": ("K", lambda: law(K=[251.0])),
    "K too fast by its eigenvalue": ("K", lambda: law(arm(), K=100 * crossed(2, 0.9), dt=0.0141)),
    "θ̂(0) too short": ("prior", lambda: law(prior=np.ones(3))),
    "θ̂(0) a matrix": ("prior", lambda: law(prior=np.ones((1, 4)))),
    "θ̂(0) with a NaN": ("prior", lambda: law(prior=[1, NAN, 1, 1])),
    "θ̂(0) infinite": ("prior", lambda: law(prior=[1, -INF, 1, 1])),
    "t NaN at first": ("t", lambda: law().init(FIRST._replace(t=NAN))),
    "q NaN at first": ("q", lambda: law().init(FIRST._replace(q=np.array([NAN])))),
    "v infinite at first": ("v", lambda: law().init(FIRST._replace(v=np.array([INF])))),
    "u NaN at first": ("u", lambda: law().init(FIRST._replace(u=np.array([NAN])))),
    "q too long at first": ("q", lambda: law().init(FIRST._replace(q=np.zeros(2)))),
    "v a number at first": ("v", lambda: law().init(FIRST._replace(v=np.float64(0)))),
    "u missing at first": ("u", lambda: law().init(FIRST._replace(u=np.zeros(0)))),
    "time stands still": ("t", lambda: follow(NEXT._replace(t=0.0))),
    "time runs back": ("t", lambda: follow(NEXT._replace(t=-0.01))),
    "time NaN": ("t", lambda: follow(NEXT._replace(t=NAN))),
    "time infinite": ("t", lambda: follow(NEXT._replace(t=INF))),
    "q too long later": ("q", lambda: follow(NEXT._replace(q=np.zeros(2)))),
    "v too long later": ("v", lambda: follow(NEXT._replace(v=np.zeros(2)))),
    "u too long later": ("u", lambda: follow(NEXT._replace(u=np.zeros(2)))),
}


@pytest.mark.parametrize("which", BAD)
def test_an_identifier_refuses_bad_arguments_with_a_reason(which: str) -> None:
    name, action = BAD[which]
    with pytest.raises(InvalidInput) as caught:
        action()
    error = caught.value
    assert error.name == name
    for part in (error.expected, str(error.got), error.remedy):
        assert part and part in str(error)


def test_the_arguments_behind_the_refused_ones_are_valid() -> None:
    assert follow(NEXT).status is Status.completed
    law(arm(), K=100 * crossed(2, 0.9), dt=0.0131)  # λ_max = 190/s, 2.49 with this dt
    law(K=[250.0])
    law(Gamma=crossed(4, 0.5))


@pytest.mark.parametrize("signal", ["q", "v"])
@pytest.mark.parametrize("value", [NAN, INF])
def test_a_nonfinite_measurement_never_yields_an_estimate(signal: str, value: float) -> None:
    with np.errstate(all="ignore"):
        try:
            state = follow(NEXT._replace(**{signal: np.array([value])}))
        except InvalidInput as error:
            assert error.name == signal
            return
    assert state.status is not Status.completed
    assert np.isfinite(state.theta_hat).all() and np.isfinite(state.v_hat).all()


SCENARIOS: dict[str, tuple[type[NsaidError], Callable[[], Scenario]]] = {
    "K too fast": (InvalidInput, lambda: replace(ROV, identifier=NullspaceAID(K=251.0))),
    "Γ negative": (InvalidInput, lambda: replace(ROV, identifier=NullspaceAID(gain=-1.0))),
    "a rival's K too fast": (
        InvalidInput,
        lambda: replace(ROV, rivals={"r": NullspaceAID(K=251.0)}),
    ),
    "everything known": (
        InvalidInput,
        lambda: replace(ROV, rivals={"r": ConventionalAID(known=tuple(rov().space.names))}),
    ),
    "an unknown known": (
        UnknownName,
        lambda: replace(ROV, rivals={"r": ConventionalAID(known=("mas",))}),
    ),
    "a vehicle cannot track": (InvalidInput, lambda: replace(ROV, excitation=FourierTracking())),
    "no such robot": (
        UnknownName,
        lambda: replace(PENDULUM, plant=replace(PENDULUM.plant, robot="dobule_pendulum")),
    ),
    "a legged file that is not there": (
        BadRobot,
        lambda: replace(PENDULUM, plant=replace(PENDULUM.plant, robot="legs/none.urdf")),
    ),
}


@pytest.mark.parametrize("which", SCENARIOS)
def test_a_scenario_that_cannot_start_writes_nothing(which: str, tmp_path: Path) -> None:
    kind, make = SCENARIOS[which]
    with pytest.raises(kind):
        run(make(), tmp_path / "a" / "run")
    assert not list(tmp_path.iterdir())


def test_a_scenario_that_cannot_start_leaves_the_run_that_was_there(tmp_path: Path) -> None:
    (tmp_path / "record.arrow").write_bytes(b"dear")
    with pytest.raises(InvalidInput):
        run(replace(ROV, identifier=NullspaceAID(K=251.0)), tmp_path)
    assert (tmp_path / "record.arrow").read_bytes() == b"dear"


@pytest.mark.parametrize("read", [Record.read, rebuild])
def test_a_folder_without_a_record_is_no_run(
    read: Callable[[Path], object], tmp_path: Path
) -> None:
    with pytest.raises(BadRun, match="record"):
        read(tmp_path)
    assert not list(tmp_path.iterdir())


# -- anything in any field ------------------------------------------------------------------------

ANYTHING = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=8)
    | st.sampled_from([10**400, 1e300, 5e-324, "\udcff", b"bytes", 1 + 2j, object]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=4,
)


@pytest.mark.parametrize("way", fields.WAYS)
@settings(deadline=None, max_examples=30, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_any_value_in_any_field_gives_a_scenario_or_a_typed_error(
    way: str, data: st.DataObject
) -> None:
    name = data.draw(st.sampled_from(sorted(scenarios())))
    path = data.draw(st.sampled_from(fields.places(name)))
    place = data.draw(st.none() | st.integers(0, len(fields.VALUES) - 1))
    value = data.draw(ANYTHING) if place is None else fields.VALUES[place]
    assert fields.outcome(way, name, {path: value}) in ("valid", "refused")


def test_the_check_detects_an_untyped_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(scenario: Scenario, values: dict[str, object]) -> Scenario:
        raise TypeError("unorderable")

    monkeypatch.setitem(fields.WAYS, "broken", broken)
    assert fields.outcome("broken", "ur5", {"dt": 1}) == "TypeError: unorderable"
