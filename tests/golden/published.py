"""What the engine of the published figures said of their cases, as records; none of these lies at a near crossing."""

from __future__ import annotations

from collections.abc import Iterator

from tests.golden.record import Errors, Record
from tests.studies.other_models import RECORD, STACKS_RECORD, OtherCase
from tests.studies.runner import recorded


def published() -> Iterator[Record]:
    """Yield a record of each case of two files of `data/blind` whose measurement nothing disturbs.

    They are `other_models.jsonl` of the shipped stack and `three_stacks.jsonl` of three in turn. A record has no value,
    no fitted errors and no seconds, and the true effects were asked for there, so that they were fitted in any case.
    `cases.draw_case` draws the same case from seed, kind, world and stack.
    """
    for case in (*recorded(RECORD, OtherCase), *recorded(STACKS_RECORD, OtherCase)):
        if case.kind != "disturbed":
            yield Record(
                seed=case.seed,
                world=case.world,
                kind=case.kind,
                setup=case.stack,
                distance=None,
                planted=case.planted,
                truth=case.truth,
                verdict=case.verdict,
                names=case.named,
                values={},
                base=_left_out(case, "before"),
                answer=_left_out(case, "after"),
                true=_left_out(case, "best") if case.truth else None,
                seconds=None,
            )


def _left_out(case: OtherCase, which: str) -> Errors:
    frequency, damping = getattr(case, which)
    return Errors(frequency=None, damping=None, left_out_frequency=frequency, left_out_damping=damping)
