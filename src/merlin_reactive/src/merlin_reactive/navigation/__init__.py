"""Plans paths, follows them and answers `move_base`."""
