"""Where the robot is on its map: a particle filter behind the topics of amcl."""
