"""Design: objectives to be differentiated and tuned."""
