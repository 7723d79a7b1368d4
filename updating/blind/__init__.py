"""The diagnosis judged on virtual tests with sealed effects."""
