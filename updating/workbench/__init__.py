"""The workbench: what a results folder holds, in a browser on this machine, with hands on it."""
