"""Many specimens on one rig, diagnosed together."""
