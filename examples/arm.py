# ---
# jupyter:
#   jupytext:
#     formats: py:percent,ipynb
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # What are a UR5's parameters, motors included?
#
# Six motors of unknown gain move six links of unknown inertia, with friction in every joint. We measure
# positions, velocities and commands, with noise. The identifier starts from numbers that are up to 30 % wrong.

# %%
import os
from pathlib import Path

import matplotlib.pyplot as plt

from nsaid_mj import ArmPlant, FourierTracking, NullspaceAID, Scenario, finish, run

seconds = float(os.environ.get("NSAID_EXAMPLE_SECONDS", "20"))  # tests make it short

scenario = Scenario(
    plant=ArmPlant(robot="ur5", damping=2.0, friction=1.0, armature=0.1),
    excitation=FourierTracking(fundamental=0.2, harmonics=10, speed=3.0),
    identifier=NullspaceAID(K=20.0, gain=0.3, law="efficient"),
    initial_error=0.3,
    duration=seconds,
    dt=2e-3,
    sensors="noisy",
)
result = run(scenario, Path("runs/example-arm"), force=True)  # replaces an earlier one
outcome = finish(result)  # summary.json, report.html and, with Rerun, run.rrd
outcome.ending.status

# %% [markdown]
# ## How close is it?
#
# All motions stay the same if masses, frictions and gains are doubled together, so the truth is a set. The distance to
# this set is the honest error. Gains are compared with one another, for the same reason.

# %%
print(
    f"distance to the true set: {outcome.accuracy.theta_perp_ratio_initial:.1%} at the start, "
    f"{outcome.accuracy.theta_perp_ratio:.3%} at the end"
)
print(
    f"largest error of a gain relative to the others: {outcome.accuracy.actuator_ratio_error:.2%}"
)
print(f"force residual on another trajectory: {outcome.accuracy.force_residual_ratio:.2e}")

# %% [markdown]
# ## The gains while the robot moves
#
# Each gain over the mean of all six, from the record. The true ratios, which the identifier never sees, are dashed.

# %%
space, record = result.system.space, result.record
gains = record["theta_hat"][:, space.actuators]
ratios = gains / gains.mean(axis=1, keepdims=True)
true = result.plant.truth[space.actuators]
true = true / true.mean()

figure, axes = plt.subplots(figsize=(8, 4), layout="constrained")
lines = axes.plot(record["t"], ratios)
for line, value in zip(lines, true, strict=True):
    axes.axhline(value, color=line.get_color(), linestyle="--", linewidth=0.8)
axes.set(xlabel="time [s]", ylabel="gain / mean of gains [1]", title="UR5: motor gains")
axes.legend(lines, [space.names[i] for i in space.actuators], fontsize="small", ncols=2)
plt.show()

# %% [markdown]
# ## What can never be known
#
# Of the 84 dimensions of θ, 27 do not affect any motion. Each is listed with the one number that would settle it.

# %%
for direction in outcome.unobservable[:5]:
    print(f"- {direction.direction[:110]}\n  {direction.fix[:110]}")

# %% [markdown]
# `nsaid view runs/example-arm` shows the run in three dimensions; `runs/example-arm/report.html` is a page to send.
