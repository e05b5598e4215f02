"""Images in, blobs out: thesis 2.1, shared by both planners."""
