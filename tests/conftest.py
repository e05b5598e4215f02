from hypothesis import settings

# The same examples every time, and no deadline: a busy machine is no failure.
settings.register_profile("gvp", deadline=None, derandomize=True)
settings.load_profile("gvp")
