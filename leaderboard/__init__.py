"""COMPARES answers: submissions to a ranking to a static site.

Comes in: run folders of `eigenbench evaluate`. Goes out: a board (a folder of records, each with the hash of the one
before) and a site of plain pages. Read in the order of the flow:
records -> chain -> standing | answer_key -> packing -> pack_scores | honesty -> duplicates -> submission -> audit
-> boards | ranking -> pieces -> task_page, entry_page, index_page -> site; `ours` makes the entries of the example
models.
"""
