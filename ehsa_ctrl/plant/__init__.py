"""A plant: parameters, structure and effects; its linear models; linearisation."""
