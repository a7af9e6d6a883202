"""Speech synthesis and sounds behind the interface of sound_play."""
