"""Files in and out: universal files, tables of numbers, units, export of modes."""
