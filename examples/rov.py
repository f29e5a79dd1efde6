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
# # An ROV loses a thruster
#
# A BlueROV2 Heavy identifies its mass, added mass, drag and eight thruster gains from how it moves. Half-way, one
# thruster loses 40 % of its thrust. Nobody tells the identifier.

# %%
import os
from pathlib import Path

import matplotlib.pyplot as plt

from nsaid_mj import BlueROV2Plant, Loss, MultisineCommand, NullspaceAID, Scenario, finish, run

seconds = float(os.environ.get("NSAID_EXAMPLE_SECONDS", "60"))  # tests make it short
weak = 3

scenario = Scenario(
    plant=BlueROV2Plant(faults=(Loss(actuator=weak, share=0.4, time=seconds / 2),)),
    excitation=MultisineCommand(low=0.1, high=1.0, tones=8, amplitude=0.8),
    identifier=NullspaceAID(K=6.0, gain=0.6, law="memory"),
    initial_error=0.3,
    duration=seconds,
    dt=0.01,
    sensors="noisy",
    record_every=2,
)
result = run(scenario, Path("runs/example-rov"), force=True)  # replaces an earlier one
outcome = finish(result)
outcome.ending.status

# %% [markdown]
# ## The gains before and after

# %%
space, record = result.system.space, result.record
gains = record["theta_hat"][:, space.actuators]
ratios = gains / gains.mean(axis=1, keepdims=True)

figure, axes = plt.subplots(figsize=(8, 4), layout="constrained")
for k, i in enumerate(space.actuators):
    own = k + 1 == weak
    axes.plot(
        record["t"],
        ratios[:, k],
        color="C3" if own else "0.6",
        linewidth=2 if own else 1,
        label=space.names[i] if own else None,
    )
axes.axvline(seconds / 2, color="k", linestyle=":", linewidth=1)
axes.set(
    xlabel="time [s]",
    ylabel="gain / mean of gains [1]",
    title=f"thruster {weak} loses 40 % at {seconds / 2:g} s",
)
axes.legend()
plt.show()

# %% [markdown]
# ## What else is known now
#
# Masses and drags come out up to one common scale: weigh the vehicle, and all of them are in SI units.

# %%
print(f"distance to the true set: {outcome.accuracy.theta_perp_ratio:.2e}")
print(
    f"largest error of a thruster's gain relative to the others: {outcome.accuracy.actuator_ratio_error:.2e}"
)
for direction in outcome.unobservable:
    print(f"- {direction.direction[:110]}\n  {direction.fix[:110]}")
