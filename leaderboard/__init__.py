"""COMPARES answers: submissions to a ranking to a static site.

Comes in: run folders of `eigenbench evaluate`. Goes out: a board (a folder of records, each with the hash of the one
before) and a site of plain pages. Read in the order of the flow:
records -> chain -> answer_key -> packing -> pack_scores -> submission | motions -> standing -> audit -> ranking ->
site with task_page, entry_page and index_page; `ours` makes the entries of the example models.
"""
