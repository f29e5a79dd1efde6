"""The files of a design: the motion as CSV, a scenario that makes it, and all figures as JSON."""

import csv
import io
import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...base import OutputFile
from ...core import NullspaceAID
from ...lab import DesignedTracking, Scenario
from .designing import Design
from .information import Ranks, rms
from .prediction import Prediction

DESIGN = "design.json"
MOTION = "motion.csv"
SCENARIO = "scenario.json"
SCRIPT = "scenario.py"

_SCRIPT = '''"""{title}: the designed motion, as `nsaid run` plays it in MuJoCo."""

from pathlib import Path

from nsaid_mj import Scenario, main

scenario = Scenario.from_json(Path(__file__).with_name("{file}").read_text(encoding="utf-8"))

if __name__ == "__main__":
    main(scenario)
'''


def scenario_of(found: Design, original: Scenario) -> Scenario:
    """The original scenario with the designed excitation, noisy sensors and the law `efficient`."""
    law = original.identifier
    if isinstance(law, NullspaceAID):
        law = replace(law, law="efficient")
    return replace(
        original,
        excitation=found.driver,
        identifier=law,
        sensors="noisy",
        noise=found.experiment.scenario.noise,
        duration=found.experiment.scenario.duration,
        pe_window=min(original.pe_window, found.experiment.scenario.duration),
    )


def write_design(
    found: Design, prediction: Prediction, ranks: Ranks, scenario: Scenario, folder: Path
) -> list[Path]:
    """Writes motion, scenario and figures into a folder, made if need be; returns the files."""
    folder.mkdir(parents=True, exist_ok=True)
    OutputFile(folder / DESIGN).write_json(design_document(found, prediction, ranks, folder.name))
    OutputFile(folder / MOTION).write_text(motion_csv(found))
    OutputFile(folder / SCENARIO).write_text(scenario.to_json() + "\n")
    OutputFile(folder / SCRIPT).write_text(_SCRIPT.format(title=folder.name, file=SCENARIO))
    return [folder / name for name in (DESIGN, MOTION, SCENARIO, SCRIPT)]


def design_document(
    found: Design, prediction: Prediction, ranks: Ranks, title: str
) -> dict[str, Any]:
    """All figures of a design, for JSON."""
    experiment = found.experiment
    return {
        "title": title,
        "asked": found.asked.words,
        "criterion": found.criterion,
        "duration": experiment.scenario.duration,
        "noise": experiment.levels._asdict(),
        "predicted_deviation": found.predicted,
        "predicted_deviation_of_prior": rms(
            found.asked.deviations(found.covariances[0], experiment.draws[0])
        ),
        "predicted_deviation_of_random_motions": found.compared.tolist(),
        "predicted_deviations": dict(prediction.asked),
        "intervals": [asdict(interval) for interval in prediction.intervals],
        "weak_directions": prediction.weak_count,
        "weak": [asdict(direction) for direction in prediction.weak],
        "unobservable": [list(pair) for pair in prediction.unobservable],
        "remedies": [
            {"words": other.words, "predicted": other.predicted, "weak": other.weak}
            for other in prediction.remedies
        ],
        "harmonics": {
            "dimension_of_P_perp": ranks.needed,
            "least_if_linear": ranks.bound,
            "enough": ranks.enough,
            "measured": [list(pair) for pair in ranks.measured],
        },
        "limits": {
            name: {
                "low": limit.low.tolist(),
                "high": limit.high.tolist(),
                "unit": limit.unit,
                "source": found.limits.sources.get(name, ""),
            }
            for name, limit in found.limits.limits.items()
        },
        "margin": found.limits.margin,
        "contacts": found.limits.contacts,
        "uses": found.uses,
        "candidates": found.evaluations,
        "excitation": json.loads(replace(experiment.scenario, excitation=found.driver).to_json())[
            "excitation"
        ],
    }


def motion_csv(found: Design) -> str:
    """The motion as CSV: t, then q, v and a of every coordinate.

    For an arm it is the planned motion; for a vehicle it is simulated under the first draw of the
    prior, since its controller decides how it is flown or steered.
    """
    system = found.experiment.system
    log = found.logs[0]
    q = log.q
    v = log.v
    a = np.gradient(log.v, log.t, axis=0)
    if isinstance(found.driver, DesignedTracking):
        rng = np.random.default_rng(0)
        driver: Any = found.driver.build(system, found.experiment.prior, rng)
        q, v, a = np.array([driver.desired(t) for t in log.t.tolist()]).transpose(1, 0, 2)
    names = system.velocity_labels
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    labels = names if q.shape[1] == len(names) else [f"{i + 1}" for i in range(q.shape[1])]
    writer.writerow(
        ["t", *(f"q_{n}" for n in labels), *(f"v_{n}" for n in names), *(f"a_{n}" for n in names)]
    )
    for row in np.column_stack([log.t, q, v, a]):
        writer.writerow([f"{x:.9g}" for x in row])
    return text.getvalue()
