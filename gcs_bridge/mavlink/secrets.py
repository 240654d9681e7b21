"""Frames that must not be kept or passed on: whoever reads them could speak in somebody's name."""

from __future__ import annotations

__all__ = ["KEY_MESSAGES", "carries_key"]
KEY_MESSAGES = ("SETUP_SIGNING",)
"""What brings a signing key."""
_V2 = 0xFD
_SETUP_SIGNING = (256).to_bytes(3, "little")  # a message of version 2 alone: in version 1 ids end at 255


def carries_key(frame: bytes) -> bool:
    """Whether the frame, as it came, is a SETUP_SIGNING: it brings the key with which a vehicle's frames are signed."""
    return frame[7:10] == _SETUP_SIGNING and frame[0] == _V2
