"""The adversarial study: is any result wrong and confident?

    python -m scripts.court --seed S [--runs 600] [--law efficient memory identify] [--jobs 2]
                            [--only exact|effects|faults|EFFECT] [--json FILE] [--case K]

Robots, motions, sensors, priors, effects and seeds are drawn afresh from `--seed`: random trees of
joints of their own generator, packed arms and vehicles. Runs come in threes that share all but the
effect; the first of three has none. Each run is short: 10 to 20 s of an arm at 2 ms, 16 to 60 s of
a vehicle, seconds of computing time, and its exception is a crash, as is more than `--limit`.
`--json` keeps a line for each run, from which an interrupted study goes on; `--tables FILE` prints
the tables of such a file. `--case K` repeats run K of a seed alone; give it the same `--law`.

What the words mean, for the laws `efficient` and `memory`, at the end of a run:

- *wrong*: less than .6 of the observable directions' 95 % intervals contain the truth; or a gain,
  relative to the common scale, is off by more than 10 of its stated standard deviations; or an
  interval is not a number; or a fault is named that is not there. Where gains fade (sag, drift), a
  loss of a gain that fades is there; of a true fault, its kind and part.
- *flagged*: the run ended early, its misfit is `some` or `contradicts`, or it found a change that
  no single fault explains.
- *unsure*: no intervals are given, or at least half of the observable directions are as uncertain
  as before the data (`below_noise` of summary.json).
- *confident*: neither flagged nor unsure; where no misfit is given at all, nobody is warned. The
  verdict's word "converged" is not used: of a simulated plant it is decided by the truth.

Of a run that is wrong and confident, `trace` says whether it could have been known: it is the sum
of the squared changes that the effect makes to all normalised innovations of the filter. Below 25,
one who knew the form of the change would see it at less than 5 standard deviations: the motion says
nothing against θ̂, and other masses or gains explain it as well as the effect does.

For `identify`:

- *wrong*: a parameter that is "identified", or a gain relative to the others, is off by more than 3
  half-widths of its interval and by more than 5 %, of a body's first moments or inertia 5 % of the
  largest of them; or an interval is not a number.
- *flagged*: the verdict is not "yes", or the log is refused. A "partly" for the common scale alone
  does not count: in half of the logs nothing fixes it, and the gains' ratios are judged.
- *unsure*: no gain is "identified", nor a ratio of gains stated.

The other bars: where the structure is exact, the shares of runs with coverage of at least .9, of
runs that are right and confident, of false faults and of flagged runs. And where an effect moves a
gain by more than 3 of the standard deviations that the same run states without the effect: the
share that is flagged or unsure, or whose own stated deviations are wide enough for the error.

    python -m scripts.court --family logs [--seeds 100:120] [--only KIND …] [--json FILE] [--jobs 2]

This family draws logs as users bring them (`tests/court/field_*.py`): each kind has one cause that
is wrong, or a shape that logs often have. A log with a cause is inspected, and its remedy obeyed
by `--fix`; a log without one is identified as it is.

- *named first*: the true cause is the first refusal, with the joints or the file it concerns;
  without a cause, that nothing is refused and what is special is found: a delay within 1 ms,
  phases within 1 s and 5 %, a constant command, nine tenths of the episodes' motion.
- *alone*: it is the only refusal.
- *ends right*: the mended log is the unchanged one, or what `identify` says of it is not wrong in
  the sense above; of a log that is not refused, what it says as it is. A remedy that is withdrawn
  does not end right; a refusal without lines of map.toml is not counted here.
- *wrong, confident*: wrong in that sense, and the verdict is "yes". A log that `inspect` refuses
  although it is healthy is not named, and not wrong.
"""

import argparse

from tests.court import command, field_study

if __name__ == "__main__":
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument("--family", choices=("effects", "logs"), default="effects")
    chosen, rest = parser.parse_known_args()
    if chosen.family == "logs":
        field_study.main(rest, __doc__)
    else:
        command.main(rest, __doc__)
