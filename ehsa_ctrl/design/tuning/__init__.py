"""From a specification to gains."""
