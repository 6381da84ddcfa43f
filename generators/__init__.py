"""MAKES data: shapes -> library -> draws and placements -> labels -> shards.

Comes in: a Recipe. Goes out: a folder of shards with its manifest. Read in the order of the data:
solids, shapes, meshes, measures -> library -> philox, surface -> tube -> fcl_engine -> generation, relabelling.
"""
