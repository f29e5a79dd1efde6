"""A weighed load on a vehicle tells the absolute size of its masses and thrusts."""

from dataclasses import replace

import numpy as np
import pytest

from nsaid_mj.clinic.identify.identify import identify_forces
from nsaid_mj.lab.library import load
from nsaid_mj.lab.setup import Setup

MASS = 0.12  # [kg]
PLACE = np.array([0.03, -0.02, -0.03])  # along the axes of the sheet [m]
AXES = ("x", "y", "z", "qx", "qy", "qz", "qw", "vx", "vy", "vz", "wx", "wy", "wz")


def with_load(theta: np.ndarray) -> np.ndarray:
    """θ of a rigid body with a mass at a point."""
    found = theta.copy()
    inertia = MASS * (PLACE @ PLACE * np.eye(3) - np.outer(PLACE, PLACE))
    found[0] += MASS
    found[1:4] += MASS * PLACE
    found[4:10] += inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
    return found


@pytest.mark.slow
def test_a_load_on_a_drone_fixes_the_scale(tmp_path):
    scenario = replace(load("hummingbird"), duration=15.0, sensors="noisy", seed=731)
    setup = Setup.of(scenario)
    truth = setup.plant.truth
    plant = scenario.plant.simulating(scenario.dt, with_load(truth))
    loaded = replace(
        setup,
        plant=plant.refined(scenario.substeps),
        scenario=replace(scenario, seed=732),
    )
    rotors = [f"rotor_{k}" for k in range(1, 5)]
    files = []
    for name, own in (("free.csv", setup), ("loaded.csv", loaded)):
        with own.plant.running():
            log = own.simulate()
        table = np.column_stack([log.t, log.q, log.v, log.u])[::4]
        head = ",".join(["time", *AXES, *rotors])
        np.savetxt(tmp_path / name, table, delimiter=",", header=head, comments="")
        files.append(tmp_path / name)
    lines = [f'"rotor {k}" = {{ column = "rotor_{k}" }}' for k in range(1, 5)]
    parts = (AXES[:3], AXES[3:7], AXES[7:10], AXES[10:])
    keys = ("position", "quaternion", "linear", "angular")
    given = [f"{key} = {list(own)}" for key, own in zip(keys, parts, strict=True)]
    mapping = tmp_path / "map.toml"
    mapping.write_text("\n".join(["[vehicle]", *given, "[actuators]", *lines]), encoding="utf-8")
    place = ",".join(map(str, PLACE.tolist()))
    found = identify_forces(
        "hummingbird", files, mapping=mapping, loads=[f"loaded.csv:{MASS}kg@body:{place}"]
    )
    assert found.explains == "yes"
    own = found.parameters[: len(truth)]
    thrusts = [k for k, p in enumerate(own) if p.name.startswith("thrust")]
    np.testing.assert_allclose([own[k].value / truth[k] for k in thrusts], 1.0, atol=0.015)
    inside = [p.low <= true <= p.high for p, true in zip(own, truth, strict=True)]
    assert all(inside[k] for k in thrusts) and np.mean(inside) > 0.9
    assert all(own[k].high / own[k].low < 1.06 for k in thrusts)
