"""Random cancels and interruptions, also while robots come and go; then all has to be as before."""
