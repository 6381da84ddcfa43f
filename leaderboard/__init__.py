"""COMPARES answers: submissions to a ranking to a static site.

Comes in: result folders. Goes out: entries and pages. Nothing has been written here yet.
"""
