"""Planning of a grasp viewpoint: everything here sees an arm only through `gvp_lib.motion.arm.EyeInHandArm`."""
