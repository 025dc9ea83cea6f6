"""Files as crashes and bad disks leave them."""

import random


def damaged(content, flips=30):
    """A file's content with one bit flipped, at places that a seed gives; cut; and empty."""
    places = random.Random(1).sample(range(8 * len(content)), flips)
    for place in places:
        flipped = bytearray(content)
        flipped[place // 8] ^= 1 << place % 8
        yield bytes(flipped)
    yield content[: len(content) // 2]
    yield b""
