"""Motion of a camera in a hand, without a simulator: everything here sees an arm only as an `EyeInHandArm`."""
