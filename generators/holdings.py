"""What the built-in library holds: roles, categories, and the number of shapes of each. No heavy imports."""

ROLES = ("object", "environment", "mug")
"""What a shape serves as: the thing that is put somewhere, the place, or the mug of the mug task."""

COUNTS: dict[str, dict[str, dict[str, int]]] = {
    "object": {
        "train": {
            "basket": 77,
            "bottle": 16,
            "bowl": 128,
            "box": 17,
            "can": 65,
            "mug": 134,
            "pot": 16,
            "trash_can": 25,
        },
        "test": {"bucket": 33, "dispenser": 9, "jar": 528, "kettle": 26},
    },
    "environment": {
        "train": {
            "box": 21,
            "microwave": 9,
            "refrigerator": 34,
            "safe": 21,
            "storage_furniture": 272,
            "table": 70,
            "washing_machine": 13,
        },
        "test": {
            "box": 7,
            "microwave": 3,
            "refrigerator": 9,
            "safe": 7,
            "storage_furniture": 73,
            "table": 25,
            "washing_machine": 3,
        },
    },
    "mug": {"train": {"mug": 160}, "test": {"mug": 40}},
}
"""Shapes per role, split and category, as in the paper's tables; object categories of the splits are disjoint."""

CATEGORIES: dict[str, dict[str, tuple[str, ...]]] = {
    role: {split: tuple(counts) for split, counts in splits.items()} for role, splits in COUNTS.items()
}
"""Categories per role and split, as in the paper; `box` is an object and an environment."""


def indices(role: str, split: str, category: str) -> range:
    """Return the indices of a split's shapes: training shapes come first, test shapes go on from there."""
    first = 0 if split == "train" else COUNTS[role]["train"].get(category, 0)
    return range(first, first + COUNTS[role][split].get(category, 0))
