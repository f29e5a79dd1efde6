"""REMUS 100: a propeller and four fins of unknown lift and drag move a torpedo under way."""

from nsaid_mj import DepthHeadingAutopilot, NullspaceAID, REMUS100Plant, Scenario, main

scenario = Scenario(
    plant=REMUS100Plant(),
    excitation=DepthHeadingAutopilot(),
    identifier=NullspaceAID(K=2.0, gain=3.0, rate=6.0, floor=0.02),
    initial_error=0.3,
    duration=600.0,
    dt=0.01,
    pe_window=20.0,
    held_out=30.0,
)

if __name__ == "__main__":
    main(scenario)
