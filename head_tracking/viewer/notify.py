"""What panels share: telling a person how it went, small print, menus that follow."""

from __future__ import annotations

import html
from typing import Any

import viser

from head_tracking.ros.kit.other_services import Outcome

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


def small(text: str) -> str:
    """A line of small print as HTML; nothing for an empty one."""
    return (
        f'<div style="padding:0 0.8em;font-size:0.85em">{html.escape(text)}</div>' if text else ""
    )


def refusal(text: str) -> str:
    """A refusal as HTML."""
    return (
        '<div style="padding:0.2em 0.8em;font-size:0.85em;color:#c92a2a">'
        f"<b>refused:</b> {html.escape(text)}</div>"
    )


def follow(menu: Any, options: tuple[str, ...], otherwise: str) -> None:
    """Lets a menu offer what there is now; what is chosen stays, if it is still there."""
    if tuple(menu.options) != options:
        chosen = menu.value
        menu.options = options
        menu.value = chosen if chosen in options else otherwise
