from merlin_planning.knowledge_client import *  # noqa: D100, F403 - its path in applications of before
