"""Where the gap between a rig and its simulation lies, which effect causes it, and how far it shrinks."""
