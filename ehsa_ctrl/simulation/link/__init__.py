"""A sampled loop over UDP: the plant on one side, the controller on the other, one packet a sample and direction."""
