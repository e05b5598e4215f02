"""What the thesis claims, sentence by sentence and cell by cell, held against the stored results."""
