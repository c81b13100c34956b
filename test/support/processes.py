"""The processes of a run, as the operating system lists them."""

from pathlib import Path


def child(pid: int, name: str) -> int:
    """Return the process id of control, vision or page; 0 if there is none."""
    for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
        try:
            words = Path(f"/proc/{word}/cmdline").read_bytes().split(b"\0")
        except OSError:
            continue  # it has just ended
        if name.encode() in words[:5]:
            return int(word)
    return 0


def has_ended(pid: int) -> bool:
    """Return whether a process has ended, though nobody may have waited for it."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return True
    return state == "Z"
