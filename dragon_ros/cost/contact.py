"""The cost of contact for a scene: the time and the result of the proved search for the first contact."""
import time
from dataclasses import dataclass

from dragon_ros.core.errors import DragonError
from dragon_ros.core.scene import Scene
from dragon_ros.core.search.certificate import Contact, NoContact
from dragon_ros.core.search.first_contact import first_contact


@dataclass(frozen=True)
class SearchCost:
    """The cost of a search: its time, its number of states, whether it completed, and its result as text."""

    elapsed_s: float
    states: int
    complete: bool
    found: str


class _OutOfTimeError(Exception):
    """The search has exceeded its budget."""


def measure(scene: Scene, budget_s: float) -> SearchCost:
    """Search for the first contact, and stop the search after about ``budget_s`` seconds."""
    began, states = time.perf_counter(), 0

    def count(more: int) -> None:
        nonlocal states
        states += more
        if time.perf_counter() - began > budget_s:
            raise _OutOfTimeError
    complete = True
    try:
        found = first_contact(scene, count)
        states, said = found.states, _said(found)
        if not found.certificate.complete:
            said += ', without a certificate'
    except _OutOfTimeError:
        complete, said = False, f'stopped after {budget_s:g} s without a result; give a longer --budget'
    except DragonError as error:
        complete, said = False, str(error)
    return SearchCost(time.perf_counter() - began, states, complete, said)


def _said(found: Contact | NoContact) -> str:
    if isinstance(found, Contact):
        return f'contact at {found.t_s:.12g} s, {found.between}'
    return f'no contact; {found.end.words} at {found.end.t_s:.9f} s'
