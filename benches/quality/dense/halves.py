"""Which shapes the constants of the reconstruction may be chosen on, and which they are shown on.

One pair a kind of difficulty, one of each pair in each half. Shapes that nobody put into a half are shown on:
nothing was chosen on them.
"""

CHOSEN_ON, SHOWN_ON = "chosen_on", "shown_on"

# kind: (chosen on, shown on)
PAIRS = {
    "scans": ("horse", "igea"),
    "long parts": ("bone", "capsule"),
    "folds": ("brain", "meander"),
    "sharp edges": ("bracket", "gear"),
    "parts that nearly touch": ("figure", "knot"),
}

# What shapes.py makes; the others are files.
GENERATED = ("bone", "capsule", "brain", "meander", "bracket", "gear", "figure", "knot")


def half(shape):
    return CHOSEN_ON if any(shape == chosen for chosen, _ in PAIRS.values()) else SHOWN_ON


def order(shape):
    """Pairs in the order above, then files that are in none, by name."""
    names = [name for pair in zip(*PAIRS.values()) for name in pair]
    return (names.index(shape) if shape in names else len(names), shape)
