"""What was measured: the campaign file, its runs and points, and their functions merged into one block of FRFs."""
