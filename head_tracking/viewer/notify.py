"""Tells the person who pressed a button how it went."""

from __future__ import annotations

from typing import Any

import viser

from head_tracking.ros.other_services import Outcome

_SECONDS_DONE, _SECONDS_FAILED = 4.0, 12.0


def notify(event: viser.GuiEvent[Any], outcome: Outcome, title: str) -> None:
    """Shows the outcome in the browser that asked; a refusal stays longer and is red."""
    if event.client is None or not outcome.text:
        return
    event.client.add_notification(
        title if outcome.done else f"{title}: refused",
        outcome.text,
        color="green" if outcome.done else "red",
        auto_close_seconds=_SECONDS_DONE if outcome.done else _SECONDS_FAILED,
    )


def by_person(event: viser.GuiEvent[Any]) -> bool:
    """Whether a person changed the input, not the page itself."""
    return event.client is not None
