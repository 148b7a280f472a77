"""Drawing: figures of the paper, top views, animations."""
