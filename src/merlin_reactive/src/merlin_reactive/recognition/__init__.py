"""Recognition of objects, people and tags in a camera image."""
