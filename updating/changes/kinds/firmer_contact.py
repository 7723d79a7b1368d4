"""More stiffness of all interfaces: pressure that rose everywhere, or another surface."""

from __future__ import annotations

from updating.changes.candidate import Candidates, Kind, amplitude, needs_contact
from updating.changes.fields import Fields, Vector
from updating.changes.kinds.everywhere import all_over, whole_contact


def candidates(fields: Fields, at: Vector) -> Candidates:  # noqa: ARG001
    """Return the change of all interfaces at once."""
    return all_over(fields, (whole_contact(fields),), 1.0, 10.0)


KIND = Kind(
    name="firmer_contact",
    label="more contact stiffness all over, as by more pressure",
    quantity="share by which it is stiffer",
    unit="1",
    why_not=needs_contact,
    candidates=candidates,
    on_plan=False,
    value=amplitude,
    local=False,
)
