"""What surrounds a feedback law: supervision, planned motion, feed-forward, rest; and the pipeline of all."""
