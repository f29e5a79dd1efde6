"""Errors about logs that cannot be read, matched or used."""

from collections.abc import Sequence

from ...base import Finding, NsaidError

_MOST = 60  # channels named in a message


class UnusableLog(NsaidError):
    """A model and log from which nothing can be identified.

    Attributes:
        findings: all findings, the refusals included.
    """

    def __init__(self, findings: tuple[Finding, ...]):
        self.findings = findings
        refusals = [f for f in findings if f.level == "refusal"]
        super().__init__("\n".join(str(f) for f in refusals))


class UnreadableLog(UnusableLog):
    """A log file that cannot be read.

    Attributes:
        path: path of the file.
        reason: what is wrong with it.
        remedy: what to do about it.
    """

    def __init__(self, path: object, reason: str, remedy: str):
        self.path = path
        self.reason = reason
        self.remedy = remedy
        super().__init__((Finding("refusal", "unreadable", str(path), reason, remedy),))


class MissingExtra(NsaidError):
    """A file format whose library is not installed.

    Attributes:
        path: path of the file.
        extra: the optional dependency to install.
    """

    def __init__(self, path: object, extra: str):
        self.path = path
        self.extra = extra
        super().__init__(
            f"{path}: reading this format needs an optional dependency. "
            f"Install it with `pip install nsaid-mj[{extra}]`."
        )


class UnmatchedChannels(NsaidError):
    """A log whose channels cannot be assigned to the robot's joints.

    Attributes:
        missing: the unmatched quantities, such as "position of shoulder_pan_joint".
        reasons: the reasons, one sentence for each unmatched quantity.
        channels: names of all channels.
    """

    def __init__(self, missing: Sequence[str], reasons: Sequence[str], channels: Sequence[str]):
        self.missing, self.reasons = tuple(missing), tuple(reasons)
        self.channels = tuple(channels)
        super().__init__(
            f"found no channels for {_listed(missing)}. {' '.join(reasons)} "
            f"The channels are {_listed(channels)}. "
            "`nsaid inspect LOG --model M` writes a first map.toml to be completed by hand; "
            "pass it with --map."
        )


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _MOST} more" if len(names) > _MOST else ""
    return ", ".join(names[:_MOST]) + more
