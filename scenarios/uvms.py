"""BlueROV2 Heavy with a Reach Alpha 5: twelve actuators of unknown gain move base and arm."""

from nsaid_mj import NullspaceAID, Scenario, SwimAndReach, UvmsPlant, main

scenario = Scenario(
    plant=UvmsPlant(),
    excitation=SwimAndReach(amplitude=0.6),
    identifier=NullspaceAID(K=20.0, gain=1.0, rate=0.5),
    initial_error=0.3,
    duration=300.0,
    dt=5e-3,
    pe_window=20.0,
    held_out=30.0,
    record_every=4,
)

if __name__ == "__main__":
    main(scenario)
