"""Catamaran: two propellers and two rudders of unknown gain; its sheet lists every force."""

from nsaid_mj import ListedPlant, MultisineCommand, NullspaceAID, Scenario, main

scenario = Scenario(
    plant=ListedPlant(),
    excitation=MultisineCommand(
        low=0.02, high=0.4, tones=8, amplitude=0.4, mean=(0.5, 0.5, 0.0, 0.0)
    ),
    identifier=NullspaceAID(K=3.0, gain=1.0, floor=1e-3),
    initial_error=0.3,
    duration=300.0,
    dt=0.01,
    pe_window=20.0,
    held_out=30.0,
)

if __name__ == "__main__":
    main(scenario)
