"""BlueROV2 Heavy: eight thrusters of unknown gain move a body of unknown mass in water."""

from nsaid_mj import BlueROV2Plant, MultisineCommand, NullspaceAID, Scenario, main

scenario = Scenario(
    plant=BlueROV2Plant(),
    excitation=MultisineCommand(low=0.1, high=1.0, tones=8, amplitude=0.8),
    identifier=NullspaceAID(K=6.0, gain=0.6, floor=1e-3),
    initial_error=0.3,
    duration=300.0,
    dt=0.01,
    pe_window=20.0,
    held_out=30.0,
)

if __name__ == "__main__":
    main(scenario)
