"""Rover: wheels in simulated contact, identified with a linear-tyre car model.

The summary's `mismatch` and assets/rover/SOURCE.md list what the structure does not model; above
all, the contact force depends on slip velocity instead of slip angle. No θ reproduces the motion,
so θ̂ cannot converge to a true set. Over eight seeds, θ̂ stays on its sphere and drifts by less than
1 % of its norm in the last 30 s (by 9 % with a gain 100 times as high). The force residual on
another trajectory, with measured v̇, falls from 0.27 … 1.5 under the prior to 0.13 … 0.38, always
below that of the θ calculated from the parts (0.19 … 0.38). The best θ of this structure, fitted to
that same trajectory, leaves 0.12 … 0.13 for three of the seeds. These figures hold for gentle
driving only: at a lateral acceleration of 2 m/s² instead of 0.7, the estimate is no better than the
prior.
"""

from nsaid_mj import Driving, NullspaceAID, RoverPlant, Scenario, main

scenario = Scenario(
    plant=RoverPlant(),
    excitation=Driving(
        speed=2.0,
        variation=0.2,
        pace_low=0.1,
        pace_high=0.6,
        grip=0.7,
        steer_low=0.05,
        steer_high=0.4,
        ground=40.0,
    ),
    identifier=NullspaceAID(K=10.0, gain=0.05),
    initial_error=0.3,
    duration=300.0,
    dt=0.005,
    pe_window=20.0,
    held_out=30.0,
)

if __name__ == "__main__":
    main(scenario)
