"""Types of fields that plants and controllers have, beside those of `base`."""

from typing import Annotated

from pydantic import Field

Share = Annotated[float, Field(strict=True, ge=0, lt=1)]
"""A share in [0, 1), such as a relative spread."""
Tones = Annotated[int, Field(strict=True, ge=1, le=1000)]
"""Number of sines in a signal; a thousand of them already need a megabyte per second."""
