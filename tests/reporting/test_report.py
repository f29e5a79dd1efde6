"""report.html: it shows what was recorded, by itself."""

import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from nsaid_mj import (
    ConventionalAID,
    MultisineCommand,
    NullspaceAID,
    ScalarRovPlant,
    Scenario,
)
from nsaid_mj import (
    evaluation as metrics,
)
from nsaid_mj.experiment.loop import SimulatedRun, run
from nsaid_mj.reporting import report
from tests.reporting.test_charts import SVG, curve

ROV = Scenario(
    plant=ScalarRovPlant(),
    excitation=MultisineCommand(low=0.05, high=0.5, tones=8, amplitude=0.8),
    identifier=NullspaceAID(K=5.0, gain=0.01),
    rivals={"conventional": ConventionalAID(K=5.0, gain=0.01)},
    duration=2.0,
    dt=0.01,
    pe_window=0.5,
    held_out=1.0,
)


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> tuple[SimulatedRun, str]:
    done = run(ROV, tmp_path_factory.mktemp("rov"))
    truth = metrics.truth_of(done)
    page = report.write(done, metrics.summarize(done, truth), truth)
    return done, page.read_text(encoding="utf-8")


def test_every_identifiers_distance_is_drawn_as_recorded(told: tuple[SimulatedRun, str]) -> None:
    done, page = told
    (picture,) = re.findall(r"<svg.*?</svg>", page)
    first = ElementTree.fromstring(picture).findall(f"{SVG}g")[0]
    words = [text.text for text in first.iter(f"{SVG}text")]
    assert "distance to the true set" in words and {metrics.OWN, "conventional"} <= set(words)
    heights = []
    for suffix, colour in (("", report._COLOURS[0]), ("_conventional", report._COLOURS[1])):
        (points,) = curve(first, colour)
        ratio = metrics.truth_of(done).distance(done.record["t"], done.record[f"theta_hat{suffix}"])
        assert len(points) == len(ratio)
        heights.append((points[:, 1], np.log10(ratio)))
    drawn, wanted = (np.concatenate(part) for part in zip(*heights, strict=True))
    slope, start = np.polyfit(wanted, drawn, 1)  # one axis for both curves, upwards
    assert slope < 0
    np.testing.assert_allclose(slope * wanted + start, drawn, atol=0.1)


def test_it_needs_no_other_file(told: tuple[SimulatedRun, str]) -> None:
    assert not re.findall(r"(?:src|href)=", told[1])


def test_a_run_of_one_row_has_a_report(tmp_path: Path) -> None:
    done = run(ROV, tmp_path)
    done.record.columns.update({name: rows[:1] for name, rows in done.record.columns.items()})
    page = report._curves(done, metrics.truth_of(done))
    assert "nan" not in page and ElementTree.fromstring(page) is not None
