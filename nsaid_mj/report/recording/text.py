"""Texts of a recording, in the characters that the viewer's font has."""

import re

_WORDS = {
    "\\_": "_",  # Markdown's; within a word neither is interpreted
    "W(t, x, v, θ) P̄_⊥ θ̄_P⊥": "the force of the observable error",
    "θ̂ converges to P(θ)": "the estimate converges to the true set",
    " ‖θ̄_P⊥‖/‖θ̂‖": "",
    "‖θ̄_P⊥‖/‖θ̂‖": "distance to the true set",
    "‖θ̂‖": "the estimate's size",
    "W θ̂": "the force residual",
    "P_⊥": "the observable directions",
}
_SPELLED = {"θ̄": "θ", "θ̂": "θ^", "_P⊥": "_perp", "P⊥": "P_perp", "⊥": "perp", "ᵀ": "'"}
_FONT = (  # ranges of Inter, the viewer's font, that names and units may need
    (0x20, 0x7E),
    (0xA0, 0x148),
    (0x300, 0x31E),
    (0x388, 0x38A),
    (0x38E, 0x3A1),
    (0x3A3, 0x3C9),
    (0x400, 0x45F),
    (0x1E00, 0x1EFF),
    (0x2010, 0x2027),
    (0x2030, 0x205E),
    (0x2070, 0x2071),
    (0x2074, 0x208E),
    (0x2190, 0x2199),
    (0x2202, 0x2202),
    (0x2206, 0x2206),
    (0x2211, 0x2212),
    (0x221A, 0x221A),
    (0x221E, 0x221E),
    (0x2248, 0x2248),
    (0x2260, 0x2260),
    (0x2264, 0x2265),
)


def application(name: str) -> str:
    """Name of the application of a recording: Rerun warns of full stops and other marks in it."""
    return re.sub(r"[^\w -]", "-", drawable(f"nsaid_mj {name}"))


def drawable(text: str) -> str:
    """Replaces symbols and characters that the viewer's font lacks.

    Rerun uses its own font only. A missing character is drawn as a box and makes its screenshots
    fail. A combining hat over θ̄ is drawn on top of the bar and is invisible, so both are spelled.
    """
    for mark, words in (_WORDS | _SPELLED).items():
        text = text.replace(mark, words)
    return "".join(c if c == "\n" or any(a <= ord(c) <= z for a, z in _FONT) else "?" for c in text)
