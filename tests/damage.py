"""Files with a bit that flipped, as disks and memories flip them."""

from pathlib import Path


def flip(path: Path, place: int | None = None) -> None:
    """Flip a bit of a byte of a file: that at some place, counted round, or the one in its middle."""
    content = bytearray(path.read_bytes())
    place = len(content) // 2 if place is None else place
    content[place % len(content)] ^= 1 << (place % 8)
    path.write_bytes(content)
