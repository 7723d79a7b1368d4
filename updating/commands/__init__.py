"""The command line: every command, what it reads and writes, and the tables it prints.

What the commands do is imported when one of them runs, and the report when there is one to make; `__init__.pyi` says
from where.
"""

from lamella_shared import exports

__all__, __getattr__, __dir__ = exports(__name__, __file__)
