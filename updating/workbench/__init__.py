"""The workbench: the results of a folder in a browser on this machine, to look at and to work with."""
