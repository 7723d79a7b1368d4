"""Factorisations and eigenvalue problems of all laminas."""
