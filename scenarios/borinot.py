"""Borinot: six rotors and two motors of unknown gain fly an arm of unknown inertia."""

from nsaid_mj import FlyingArmPlant, HoverAndReach, NullspaceAID, Scenario, main

scenario = Scenario(
    plant=FlyingArmPlant(robot="borinot"),
    excitation=HoverAndReach(travel=1.0, fundamental=0.12, speed=5.0, dither=0.2),
    identifier=NullspaceAID(K=40.0, gain=2.0),
    initial_error=0.3,
    duration=60.0,
    dt=2e-3,
    pe_window=10.0,
    held_out=10.0,
)

if __name__ == "__main__":
    main(scenario)
