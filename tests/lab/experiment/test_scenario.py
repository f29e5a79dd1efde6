"""A scenario is data: it survives JSON, its hash identifies it, bad fields are named."""

import json
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from typing import Any, get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nsaid_mj.base.errors import InvalidInput, UnknownName
from nsaid_mj.core.laws.config import NullspaceAID
from nsaid_mj.core.laws.conventional import ConventionalAID
from nsaid_mj.core.laws.settings import EfficientConfig, MemoryConfig
from nsaid_mj.lab.control.adaptive.tracker import AdaptiveTracking
from nsaid_mj.lab.control.autopilot import DepthHeadingAutopilot
from nsaid_mj.lab.control.driver import DriverConfig
from nsaid_mj.lab.control.driving import Driving
from nsaid_mj.lab.control.multisine import AxisMultisine, MultisineCommand
from nsaid_mj.lab.control.pose_hold import PoseHold
from nsaid_mj.lab.control.quadrotor import QuadrotorFlight
from nsaid_mj.lab.control.sequence import Phase, Sequence
from nsaid_mj.lab.control.tracking import DesignedSignals, DesignedTracking, FourierTracking
from nsaid_mj.lab.control.vehicle_manipulator import HoverAndReach, SwimAndReach
from nsaid_mj.lab.library import load
from nsaid_mj.lab.plants.jointed import (
    ArmPlant,
    Backend,
    FloatingBasePlant,
    FlyingArmPlant,
    RoverPlant,
    UvmsPlant,
)
from nsaid_mj.lab.plants.scalar_rov import ScalarRovPlant
from nsaid_mj.lab.plants.vehicles import (
    AstrobeePlant,
    BlueROV2Plant,
    BMW320iPlant,
    F1TenthPlant,
    QuadrotorPlant,
    REMUS100Plant,
)
from nsaid_mj.lab.plants.world.faults.kinds import (
    Bias,
    Broken,
    Friction,
    Loss,
    Payload,
    Reversed,
    Stuck,
)
from nsaid_mj.lab.plants.world.mismatch import Mismatch
from nsaid_mj.lab.plants.world.noise import SensorNoise
from nsaid_mj.lab.scenario import Scenario
from nsaid_mj.robots.assets import scenarios

NAN, INF = np.nan, np.inf
FEW = settings(deadline=None, max_examples=50)
positive, share = st.floats(1e-9, 1e9), st.floats(0, 0.99)
text = st.text(st.characters(exclude_categories=["Cs"]), max_size=8)
guess, backend = st.none() | positive, st.sampled_from(get_args(Backend))
PLANT = st.builds(ScalarRovPlant, positive, positive, positive, positive, share) | st.builds(
    ArmPlant, text, guess, guess, guess, positive, share, positive, backend
)
DRIVER = st.builds(
    FourierTracking, positive, st.integers(1, 9), st.floats(0.01, 1), positive, guess
) | st.builds(
    MultisineCommand, st.floats(0.01, 1), st.floats(2, 9), st.integers(1, 9), st.floats(0.01, 1)
)
LAW = st.builds(
    NullspaceAID, positive, positive, st.sampled_from(["auto", "hermite", "linear"])
) | st.builds(ConventionalAID, positive, positive, st.lists(text, max_size=3).map(tuple))
SCENARIO = st.builds(
    Scenario,
    plant=PLANT,
    excitation=DRIVER,
    identifier=LAW,
    rivals=st.dictionaries(st.from_regex(r"[a-zé_]{1,3}", fullmatch=True), LAW, max_size=2),
    prior=st.sampled_from(["drawn", "nominal"]),
    initial_error=share,
    gain_error=st.none() | share,
    duration=st.floats(1, 1000),
    dt=st.floats(1e-6, 0.1),
    sensors=st.sampled_from(["ideal", "noisy"]),
    noise=st.builds(SensorNoise, share, share, share),
    pe_window=positive,
    held_out=st.floats(1e-9, 1),
    substeps=st.integers(1, 99),
    record_every=st.integers(1, 99),
    seed=st.integers(0, 2**64),
)


def same(scenario: Scenario) -> None:
    again = Scenario.from_json(scenario.to_json())
    assert again == scenario and type(again) is Scenario
    assert again.hash == scenario.hash and again.to_json() == scenario.to_json()


@pytest.mark.parametrize("name", scenarios())
def test_a_packed_scenario_survives_JSON(name):
    same(load(name))


def test_packed_scenarios_exist_and_differ():
    assert {"ur5", "double_pendulum", "scalar_rov"} <= set(scenarios())
    hashes = [load(name).hash for name in scenarios()]
    assert len(set(hashes)) == len(hashes)


@FEW
@given(SCENARIO)
def test_any_scenario_survives_JSON(scenario):
    same(scenario)
    json.loads(scenario.to_json(), parse_constant=lambda name: pytest.fail(f"{name} in JSON"))


@pytest.mark.parametrize("name", ["conventional", "type", "plant", "é"])
def test_any_identifier_may_name_a_rival(name):
    same(Scenario(rivals={name: ConventionalAID()}))


# -- the hash --------------------------------------------------------------------------------


def changed(value: Any, name: str) -> Iterator[Any]:
    """Every value that differs from this one in one number, by the least possible."""
    if is_dataclass(value) and not isinstance(value, type):
        for field in fields(value):
            for other in changed(getattr(value, field.name), field.name):
                moved = isinstance(other, Mismatch) and (any(other.flow) or other.fluid != "exact")
                if moved and isinstance(value, ArmPlant | ScalarRovPlant):
                    continue  # neither has water or wind about it
                yield replace(value, **{field.name: other})
    elif isinstance(value, dict):
        yield value | {"another": NullspaceAID()}
        for key, item in value.items():
            yield {k: v for k, v in value.items() if k != key}
            yield from (value | {key: other} for other in changed(item, key))
    elif isinstance(value, tuple) and name == "faults":
        yield (Loss(),) if not value else ()
        for i, item in enumerate(value):
            yield from ((*value[:i], other, *value[i + 1 :]) for other in changed(item, ""))
    elif isinstance(value, tuple) and name == "flow":
        yield (0.1, 0.0, 0.0)
    elif isinstance(value, tuple) and name == "unexplained":
        yield (1e-3,)
    elif isinstance(value, tuple) and name == "mean":
        yield (0.5,)
    elif isinstance(value, tuple):
        yield (*value, "mass")
        yield ()
    elif isinstance(value, str):
        others = {
            "sensors": "noisy",
            "interpolation": "linear",
            "gamma": "simulated",
            "law": "cone",
            "fluid": "ellipsoid",
            "backend": "pinocchio",
            "actuator": "servo",
            "prior": "nominal",
        }
        yield others.get(name, value + "_")
    elif isinstance(value, int):
        yield value + 1
    elif value is None and name == "joints":
        yield (1,)
    elif value is None:
        yield 0.5
    else:
        assert isinstance(value, float)
        yield float(np.nextafter(value, 0.4))


WHOLE = Scenario(
    rivals={"known": ConventionalAID()}, plant=ArmPlant(damping=2.0, gain=1.5, actuator="motor")
)
SCALAR = Scenario(plant=ScalarRovPlant(), excitation=MultisineCommand(), identifier=NullspaceAID())


WET = Scenario(plant=BlueROV2Plant(), excitation=MultisineCommand())


@pytest.mark.parametrize("scenario", [WHOLE, SCALAR, WET], ids=["arm", "scalar", "rov"])
def test_the_hash_changes_with_any_field(scenario):
    others = list(changed(scenario, ""))
    leaves = scenario.to_json().count('": ') - scenario.to_json().count('"$type": ')
    assert len(others) >= leaves - 10  # at least one for each number (the rest are containers)
    for other in others:
        assert other != scenario
        same(other)
    assert len({scenario.hash, *(other.hash for other in others)}) == 1 + len(others)


def test_scenarios_that_differ_in_type_differ_in_hash():
    laws = NullspaceAID(K=2.0), ConventionalAID(K=2.0)
    assert len({Scenario(identifier=law).hash for law in laws}) == 2
    assert len(WHOLE.hash) == 12 and int(WHOLE.hash, 16) >= 0


# -- reading ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["Nothing", "main", "run", "Measurement", "__version__", 7, None])
def test_a_foreign_type_is_refused(name):
    tree = json.loads(WHOLE.to_json())
    tree["plant"]["$type"] = name
    with pytest.raises(InvalidInput):
        Scenario.from_json(json.dumps(tree))


@pytest.mark.parametrize(
    "text",
    [
        "[]",
        "{}",
        "3",
        "not json",
        '{"$type": "SensorNoise"}',
        '{"$type": "Scenario", "colour": "red"}',
    ],
)
def test_json_that_is_no_scenario_is_refused(text):
    with pytest.raises(InvalidInput):
        Scenario.from_json(text)


def test_the_path_of_an_error_in_json_is_named():
    tree = json.loads(WHOLE.to_json())
    tree["identifier"]["memory"]["window"] = -1
    with pytest.raises(InvalidInput) as caught:
        Scenario.from_json(json.dumps(tree))
    assert caught.value.name == "identifier.memory.window"
    assert caught.value.got == -1 and "another version" in caught.value.remedy


@pytest.mark.parametrize("value", ["NaN", "Infinity", "-Infinity", "1e999"])
def test_json_with_a_number_that_is_not_finite_is_refused(value):
    text = WHOLE.to_json().replace('"duration": 60.0', f'"duration": {value}')
    assert value in text
    with pytest.raises(InvalidInput) as caught:
        Scenario.from_json(text)
    assert caught.value.name == "duration"


@pytest.mark.parametrize("text", ["[" * 10**5, "\udcff", "9" * 5000, '{"$type": ["Scenario"]}'])
def test_json_that_cannot_be_parsed_is_refused(text):
    with pytest.raises(InvalidInput):
        Scenario.from_json(text)


# -- classes of a user's script ---------------------------------------------------------------


@dataclass(frozen=True)
class Gentle(MultisineCommand):
    """An excitation as a script would define it, with no decorator of ours."""

    share: float = 0.5


def test_a_class_defined_in_a_script_survives_json():
    scenario = Scenario(excitation=Gentle(high=1.0, share=0.25))
    same(scenario)
    assert isinstance(Scenario.from_json(scenario.to_json()).excitation, Gentle)
    assert json.loads(scenario.to_json())["excitation"]["$type"] == "Gentle"


@pytest.mark.parametrize("values", [{"share": [1]}, {"low": "x"}, {"amplitude": NAN}])
def test_fields_of_a_class_defined_in_a_script_are_checked(values):
    with pytest.raises(InvalidInput) as caught:
        Scenario(excitation=Gentle(**values))
    assert caught.value.name == f"excitation.{next(iter(values))}"


# -- the schema -------------------------------------------------------------------------------


def options(definition: dict, definitions: dict) -> dict[str, dict]:
    """The schemas of an abstract class's kinds, by `$type`."""
    found = [
        definitions[part["$ref"].rpartition("/")[2]] if "$ref" in part else part
        for part in definition["oneOf"]
    ]
    return {option["properties"]["$type"]["const"]: option for option in found}


def test_the_schema_offers_every_class_by_its_type():
    definitions = Scenario.json_schema()["$defs"]
    offered = {
        kind
        for name in ("PlantConfig", "DriverConfig", "IdentifierConfig", "Fault")
        for kind in options(definitions[name], definitions)
    }
    parts = {
        type(part).__name__
        for name in scenarios()
        for s in (load(name),)
        for part in (s.plant, s.excitation, s.identifier)
    }
    assert parts | {"Gentle"} | {part.__name__ for part in FAULTS} <= offered


def test_the_schema_states_the_bounds():
    definitions = Scenario.json_schema()["$defs"]
    share = options(definitions["Fault"], definitions)["Loss"]["properties"]["share"]
    assert share["exclusiveMinimum"] == 0 and share["exclusiveMaximum"] == 1


# -- bad fields ------------------------------------------------------------------------------

NOT_POSITIVE = [0.0, -1.0, NAN, INF]
BAD_ARM = {
    "damping": NOT_POSITIVE,
    "friction": NOT_POSITIVE,
    "armature": [-1.0, NAN, INF],
    "gain": [0.0, -1.0, NAN, INF],
    "spread": [-0.1, 1.0, NAN],
    "friction_speed": NOT_POSITIVE,
    "backend": ["fortran", ""],
    "actuator": ["hydraulic", ""],
}
NO_SHARE = [0.0, -0.1, 1.01, NAN]
TIMES = {"time": [-1.0, NAN, INF], "until": [-1.0, 0.0, NAN]}
BROKEN = TIMES | {"actuator": [0, -1, 1.5]}
FAULTS = {
    Loss: BROKEN | {"share": [0.0, -0.1, 1.0, NAN], "rate": NOT_POSITIVE},
    Reversed: BROKEN,
    Broken: BROKEN,
    Stuck: BROKEN | {"holding": [NAN, INF, "last"]},
    Friction: TIMES | {"by": NOT_POSITIVE, "parameter": [1, None]},
    Payload: TIMES
    | {
        "mass": NOT_POSITIVE,
        "place": [(0.0, 0.0), (0.0, 0.0, NAN), 1.0],
        "link": [6, None],
    },
    Bias: TIMES | {"by": [NAN, INF], "sensor": ["force", ""], "channel": [0, -1, 1.5]},
}
BAD = FAULTS | {
    Scenario: {
        "dt": NOT_POSITIVE,
        "duration": [*NOT_POSITIVE, 1.9e-3],
        "pe_window": NOT_POSITIVE,
        "held_out": NOT_POSITIVE,
        "initial_error": [-0.1, NAN, INF],
        "gain_error": [-0.1, 1.0, NAN],
        "record_every": [0, 1.5, -1],
        "substeps": [0, 1.5, -1, 1001],
        "prior": ["true", ""],
        "seed": [-1, 0.5],
        "sensors": ["perfect", ""],
        "rivals": [{"": NullspaceAID()}, {"two words": NullspaceAID()}],
    },
    ArmPlant: BAD_ARM,
    FloatingBasePlant: BAD_ARM,
    UvmsPlant: {"spread": [-0.1, 1.0, NAN]},
    REMUS100Plant: {"spread": [-0.1, 1.0, NAN]},
    DepthHeadingAutopilot: {
        "propeller": [0.0, 0.2, 1.01, NAN],
        "swing": NOT_POSITIVE,
        "dither": NOT_POSITIVE,
        "low": [0.0, -1.0, NAN, 2.1],
        "high": [0.05, NAN, INF],
        "tones": [0, -1],
        "slow": NOT_POSITIVE,
        "depth": [NAN, INF],
        "dive": NOT_POSITIVE,
        "turn": NOT_POSITIVE,
        "bandwidth": NOT_POSITIVE,
    },
    FlyingArmPlant: {"spread": [-0.1, 1.0, NAN]},
    SwimAndReach: {
        "low": [0.0, -1.0, NAN, 0.6],
        "high": [0.05, NAN, INF],
        "tones": [0, -1],
        "amplitude": NO_SHARE,
        "fundamental": NOT_POSITIVE,
        "harmonics": [0, -1],
        "reach": NO_SHARE,
        "speed": NOT_POSITIVE,
        "bandwidth": NOT_POSITIVE,
    },
    HoverAndReach: {
        "travel": NOT_POSITIVE,
        "turn": NOT_POSITIVE,
        "fundamental": NOT_POSITIVE,
        "harmonics": [0, -1],
        "reach": NO_SHARE,
        "speed": NOT_POSITIVE,
        "dither": NO_SHARE,
        "low": [0.0, -1.0, NAN, 3.1],
        "high": [0.5, NAN, INF],
        "tones": [0, -1],
        "position_bandwidth": NOT_POSITIVE,
        "attitude_bandwidth": NOT_POSITIVE,
    },
    ScalarRovPlant: {
        "mass": NOT_POSITIVE,
        "drag": NOT_POSITIVE,
        "gain": NOT_POSITIVE,
        "net_weight": [0.0, NAN, INF],
        "spread": [-0.1, 1.0, NAN],
    },
    FourierTracking: {
        "fundamental": NOT_POSITIVE,
        "harmonics": [0, -1],
        "reach": [0.0, 1.01, NAN],
        "bandwidth": NOT_POSITIVE,
        "speed": NOT_POSITIVE,
        "joints": [(0,), (9,), (1.5,)],
        "limit": NOT_POSITIVE,
    },
    DesignedTracking: {
        "fundamental": NOT_POSITIVE,
        "centre": [(), (NAN,)],
        "sines": [(), (0.1, 0.2), (INF,)],
        "cosines": [(), (0.1, 0.2), (NAN,)],
        "bandwidth": NOT_POSITIVE,
    },
    DesignedSignals: {"driver": [None, 1], "shares": [(0.5,), (1.1,), (NAN,)]},
    AdaptiveTracking: {
        "law": ["pid"],
        "rate": NOT_POSITIVE,
        "damping": NOT_POSITIVE,
        "adaptation": NOT_POSITIVE,
        "floor": NO_SHARE,
        "barrier": NOT_POSITIVE,
        "period": NOT_POSITIVE,
        "fundamental": NOT_POSITIVE,
        "harmonics": [0, -1],
        "reach": NO_SHARE,
        "speed": NOT_POSITIVE,
        "travel": [-1.0, NAN, INF],
        "tilt": [-1.0, NAN, INF],
        "heading": [-1.0, NAN, INF],
    },
    AxisMultisine: {
        "axes": [(), ("up",)],
        "low": [0.0, -1.0, NAN, 0.6],
        "high": [0.05, NAN, INF],
        "tones": [0, -1],
        "amplitude": [-1.0, NAN, INF],
    },
    Phase: {"duration": NOT_POSITIVE, "driver": [None]},
    Sequence: {"phases": [{}, {"two words": Phase()}], "blend": [-1.0, NAN, INF]},
    MultisineCommand: {
        "low": [0.0, -1.0, NAN, 0.6],
        "high": [0.05, NAN, INF],
        "tones": [0, -1],
        "amplitude": [-1.0, NAN, INF],
        "mean": [(0.1, 0.2, 0.3), (NAN, 0.0)],
    },
    NullspaceAID: {
        "K": [*NOT_POSITIVE, 1e9],
        "gain": NOT_POSITIVE,
        "interpolation": ["spline"],
        "gamma": ["best"],
        "law": ["newton"],
        "barrier": [-1.0, NAN, INF],
        "rate": NOT_POSITIVE,
        "floor": [0.0, -0.1, 1.01, NAN],
    },
    MemoryConfig: {
        "window": NOT_POSITIVE,
        "block": NOT_POSITIVE,
        "interval": NOT_POSITIVE,
        "pace": NOT_POSITIVE,
        "anchor": [-1.0, NAN, INF],
        "horizon": [-1.0, NAN, INF],
    },
    EfficientConfig: {
        "prior": NOT_POSITIVE,
        "linearisation": [-1.0, NAN, INF],
        "innovation_window": NOT_POSITIVE,
        "unexplained": [(-1.0,), (NAN,), 1.0, None],
    },
    Mismatch: {
        "lag": [-1.0, NAN, INF],
        "delay": [-1.0, NAN, INF],
        "fluid": ["honey"],
        "flow": [(1.0, 2.0), (0.0, 0.0, NAN), ("a", "b", "c")],
    },
    BlueROV2Plant: {"spread": [-0.1, 1.0, NAN]},
    AstrobeePlant: {"spread": [-0.1, 1.0, NAN]},
    QuadrotorPlant: {"spread": [-0.1, 1.0, NAN]},
    QuadrotorFlight: {
        "radius": NOT_POSITIVE,
        "speed": NOT_POSITIVE,
        "climb": NOT_POSITIVE,
        "yaw_rate": NOT_POSITIVE,
        "tilt": [*NOT_POSITIVE, 1.6],
        "bandwidth": NOT_POSITIVE,
        "attitude_bandwidth": NOT_POSITIVE,
        "dither": [*NOT_POSITIVE, 1.0],
        "low": [0.0, -1.0, NAN, 9.1],
        "high": [2.9, NAN, INF],
    },
    PoseHold: {
        "bandwidth": NOT_POSITIVE,
        "period": NOT_POSITIVE,
        "travel": [-1.0, NAN, INF],
        "turn": [-1.0, NAN, INF],
        "bias": [-1.0, NAN, INF],
        "dither": NOT_POSITIVE,
        "low": [0.0, -1.0, NAN, 0.6],
        "high": [0.05, NAN, INF],
        "tones": [0, -1],
        "one_sided": ["yes"],
    },
    ConventionalAID: {
        "K": [*NOT_POSITIVE, 1e9],
        "gain": NOT_POSITIVE,
        "known": [(), ("mass", "drag", "net weight", "thruster gain")],
    },
    F1TenthPlant: {"spread": [-0.1, 1.0, NAN]},
    BMW320iPlant: {"spread": [-0.1, 1.0, NAN]},
    RoverPlant: {"spread": [-0.1, 1.0, NAN]},
    Driving: {
        "speed": NOT_POSITIVE,
        "variation": [0.0, -0.1, 0.56, NAN],
        "grip": NOT_POSITIVE,
        "pace_low": [0.0, -1.0, NAN, 0.9],
        "pace_high": [0.1, NAN, INF],
        "steer_low": [0.0, -1.0, NAN, 5.1],
        "steer_high": [0.4, NAN, INF],
        "tones": [0, -1],
        "ground": NOT_POSITIVE,
    },
    SensorNoise: {"position": [-1.0, NAN], "velocity": [-1.0, INF], "encoder_step": [-1.0, NAN]},
}
ALSO = {
    "gain": "Gamma",
    "low": "band",
    "high": "band",
    **dict.fromkeys(("pace_low", "pace_high", "steer_low", "steer_high"), "band"),
    **dict.fromkeys(("centre", "cosines"), "sines"),
    "dither": "amplitude",
}  # the paper's letter; one field, two ends; one series, three parts
# Some need data that only another part of the scenario tells.
VALID = {
    ConventionalAID: {"known": ("mass",)},
    DesignedTracking: {"centre": (0.0, 0.0), "sines": (0.5, 0.5), "cosines": (0.0, 0.0)},
    DesignedSignals: {"shares": (0.5,) * 32},
}


DRIVEN = {
    AxisMultisine: BlueROV2Plant(),
    Driving: F1TenthPlant(),
    SwimAndReach: UvmsPlant(),
    PoseHold: AstrobeePlant(),
    HoverAndReach: FlyingArmPlant(),
    DepthHeadingAutopilot: REMUS100Plant(),
    QuadrotorFlight: QuadrotorPlant(),
}  # others drive any arm


@cache
def plant(config):
    return config.build(1e-3, 0)


def use(part) -> None:
    """Makes what a part of a scenario describes, as a run would before its first step."""
    scalar = plant(ScalarRovPlant())
    if isinstance(part, NullspaceAID | ConventionalAID):
        part.build(scalar.system, scalar.truth, 1e-3)
    elif isinstance(part, DriverConfig):
        config = DRIVEN.get(type(part), ArmPlant(robot="double_pendulum"))
        part.build(plant(config).system, plant(config).truth, np.random.default_rng(0))


@pytest.mark.parametrize(
    "part,field",
    [(part, name) for part, bad in BAD.items() for name in bad],
    ids=lambda x: getattr(x, "__name__", None) or str(x),
)
def test_a_bad_field_is_named_before_the_run(part, field):
    for value in BAD[part][field]:
        with pytest.raises(InvalidInput) as caught:
            use(part(**{field: value}))
        error = caught.value
        names = {field, ALSO.get(field, field)}
        assert names & set(error.name.split(".")), value
        assert error.expected and error.remedy and str(error.got) in str(error), value


@pytest.mark.parametrize("part", BAD, ids=lambda part: part.__name__)
def test_every_field_has_bad_values_listed_and_a_valid_default(part):
    parts = {
        "plant",
        "excitation",
        "identifier",
        "noise",
        "robot",
        "vehicle",
        "mismatch",
        "faults",
        "memory",
        "efficient",
    }
    assert {f.name for f in fields(part)} - set(BAD[part]) <= parts
    use(part(**VALID.get(part, {})))


def test_an_unknown_name_in_known_is_refused_with_near_names():
    with pytest.raises(UnknownName) as caught:
        use(ConventionalAID(known=("thruster gian",)))
    assert "thruster gain" in caught.value.near
