"""Fewer degrees of freedom: a through-thickness basis, snapshots, projection."""
