"""The command line: every command, what it reads and writes, and the tables it prints."""
