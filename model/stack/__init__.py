"""What a stack is: sheets, steel, outline, clamps, contact, and the file that describes it."""
