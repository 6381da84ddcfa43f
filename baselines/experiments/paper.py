"""What the paper states in its text, and nothing read off its figures (Weng et al., ICML 2023)."""

NOT_PUBLISHED = "not published"

STATED: dict[str, str] = {
    "implicit R2": "close to or greater than 0.9, but for the spare slot of top",
    "grounded R2": "close to 1 on fit and top",
    "spare slot of top": "decides in 0.4 % of the cases",
    "data efficiency": "Grounded is below Direct under 3,000 pairs",
}
"""Statements about whole groups of rows; accuracies of single tasks are in no table and no sentence."""

ROWS: dict[str, str] = {
    "c-direct-1": "73.14",
    "c-direct-100": "88.47",
    "c-implicit": "97.71",
    "c-grounded": "99.48",
    "e-implicit": "99.59",
}
"""Accuracies in percent by row."""

ROTATION_DEGREES = {"fit-rotated": 25.39, "tube-rotated": 13.63}
"""Mean error of the relative rotation between two environments."""
