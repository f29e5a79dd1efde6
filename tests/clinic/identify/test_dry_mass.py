"""The weighed mass of a ROV fixes its scale as far as the added mass is known."""

from dataclasses import replace

import numpy as np
import pytest

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.clinic.identify.dry_mass import scale_deviation, stated_mass, with_dry_mass
from nsaid_mj.clinic.identify.identify import identify
from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.lab.library import load
from nsaid_mj.lab.plants.vehicles import BlueROV2Plant
from nsaid_mj.lab.setup import Setup
from nsaid_mj.robots.assets import asset

MASS, ADDED = 15.5, np.array([5.0, 8.5, 16.0])


@pytest.fixture(scope="module")
def heavier(tmp_path_factory):
    """The log of a ROV with a heavier hull and other added masses than the sheet's."""
    folder = tmp_path_factory.mktemp("rov")
    text = asset("bluerov2", "vehicle.toml").read_text(encoding="utf-8")
    text = text.replace("mass = 13.5 ", f"mass = {MASS} ").replace(
        "volume = 0.0134", "volume = 0.0154"
    )
    text = text.replace("[6.36, 7.12, 18.68,", f"[{', '.join(map(str, ADDED))},")
    sheet = folder / "heavier.toml"
    sheet.write_text(text, encoding="utf-8")
    scenario = replace(
        load("bluerov2"), plant=BlueROV2Plant(vehicle=str(sheet)), duration=20.0, sensors="noisy"
    )
    setup = Setup.of(scenario)
    with setup.plant.running():
        log = setup.simulate()
    parts = zip("qvu", (log.q, log.v, log.u), strict=True)
    names = ["t", *(f"{name}_{k}" for name, part in parts for k in range(part.shape[1]))]
    table = np.column_stack([log.t, log.q, log.v, log.u])
    path = folder / "log.csv"
    np.savetxt(path, table, delimiter=",", header=",".join(names), comments="", fmt="%.9g")
    return path, dict(zip(setup.system.space.labels, setup.plant.truth.tolist(), strict=True))


def test_a_known_dry_mass_gives_gains_and_added_mass(heavier):
    path, truth = heavier
    found = identify("bluerov2", path, known={"m": MASS})
    own = {p.label: p for p in found.parameters}
    assert found.explains == "yes" and "the known m" in found.anchor
    gains = [(own[x], true) for x, true in truth.items() if x.startswith("thrust of")]
    assert all(p.low <= true <= p.high and p.status == "identified" for p, true in gains)
    (note,) = [f for f in found.findings if f.code == "added_mass"]
    for way, added in zip(("surge", "sway", "heave"), ADDED, strict=True):
        value, low, high = note.data[way]
        assert low <= added <= high
        assert low <= value <= high


def test_without_it_the_sheets_is_said(heavier):
    found = identify("bluerov2", heavier[0])
    (note,) = [f for f in found.findings if f.code == "added_mass"]
    assert "sheet's 13.5 kg" in note.text and "--known m" in note.remedy


def test_what_a_dry_mass_is(heavier):
    rov = load_robot_model("bluerov2")
    assert stated_mass(rov, {"m": 13.9}) == 13.9 and stated_mass(rov, {"thrust_1": 2.0}) is None
    assert stated_mass(load_robot_model("hummingbird"), {"m": 0.5}) is None
    weighed = with_dry_mass(rov, 14.5)
    assert weighed.prior[0] == pytest.approx(rov.prior[0] + 1.0)
    assert 0.05 < scale_deviation(weighed) < 0.15
    for mass in (-1.0, 139.0):
        with pytest.raises(InvalidInput, match="without water"):
            with_dry_mass(rov, mass)
