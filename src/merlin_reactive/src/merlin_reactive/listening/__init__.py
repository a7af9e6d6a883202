"""Speech recognition: understands one utterance at a time."""
