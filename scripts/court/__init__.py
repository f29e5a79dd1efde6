"""The adversarial study; `scripts/court.py` is its command."""
