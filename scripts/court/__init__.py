"""The adversarial study of issue "never wrong with confidence"; `scripts/court.py` is its command."""
