"""What the answers of servos say."""

from __future__ import annotations

from head_tracking.dynamixel.answer import Answer
from head_tracking.dynamixel.exceptions import CorruptReplyError
from head_tracking.dynamixel.port import Reply
from head_tracking.dynamixel.protocol import (
    ALERT,
    ErrorBits,
    Status,
    StatusCode,
    describe_errors,
    describe_status,
)


def reply_of(protocol: int, servo_id: int, answer: Answer, length: int, what: str) -> Reply:
    """Return what an answer says.

    Args:
        protocol: 1 or 2.
        servo_id: The servo.
        answer: What came, if not in vain.
        length: How many bytes of data there should be.
        what: The question, for messages.

    Raises:
        CorruptReplyError: The answer or the question was damaged, or they do not fit.
    """
    if not isinstance(answer, Status):
        raise CorruptReplyError(f"servo {servo_id}: damaged reply to a {what}")
    error = answer.error
    if (error & ErrorBits.CHECKSUM) if protocol == 1 else error & ~ALERT == StatusCode.CRC:
        raise CorruptReplyError(f"servo {servo_id} received a damaged {what}")
    if len(answer.data) != length:
        told = describe_errors(ErrorBits(error)) if protocol == 1 else describe_status(error)
        raise CorruptReplyError(
            f"servo {servo_id} answered a {what} with {len(answer.data)} byte(s) of "
            f"data; error bits: {told}"
        )
    return Reply(answer.data, ErrorBits(error) if protocol == 1 else error)
