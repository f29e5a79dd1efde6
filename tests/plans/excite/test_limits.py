"""Files of limits."""

from pathlib import Path

import numpy as np
import pytest

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.plans.excite.limits import Limit, Limits, read_limits


@pytest.mark.parametrize("value", ["9" * 400, "1e300", "-" + "9" * 400, "nan", "[1, 2, 3]", "true"])
@pytest.mark.parametrize("name", ["speed", "margin"])
def test_what_is_no_limit_is_refused_by_name(name: str, value: str, tmp_path: Path):
    ones = np.ones(2)
    own = Limits({"speed": Limit(-ones, ones, "rad/s")})
    (tmp_path / "limits.toml").write_text(f"{name} = {value}\n")
    with pytest.raises(InvalidInput, match=rf"limits\.{name}") as error:
        read_limits(tmp_path / "limits.toml", own)
    assert len(str(error.value)) < 400
