"""A sampled loop over UDP: the plant on one side, the controller on the other, one packet a sample and direction."""

#: How long one side waits for the other [s], by default: a person needs some time for the second terminal, and a busy
#: machine for loading it.
PATIENCE = 60.0
