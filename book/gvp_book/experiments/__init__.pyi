"""The names of the room, one a line: for type checkers, editors, and ``gvp_lib.lazy``."""

from gvp_book.experiments import alignment as alignment
from gvp_book.experiments import grasping as grasping
from gvp_book.experiments import learned as learned
from gvp_book.experiments import networks as networks
from gvp_book.experiments import reach as reach
from gvp_book.experiments.alignment import align_once as align_once
from gvp_book.experiments.alignment import alignment_jobs as alignment_jobs
from gvp_book.experiments.grasping import grasp_cell as grasp_cell
from gvp_book.experiments.grasping import grasp_once as grasp_once
from gvp_book.experiments.grasping import grasping_jobs as grasping_jobs
from gvp_book.experiments.learned import following_jobs as following_jobs
from gvp_book.experiments.learned import learned_jobs as learned_jobs
from gvp_book.experiments.learned import spec_of as spec_of
from gvp_book.experiments.networks import CLOSER as CLOSER
from gvp_book.experiments.networks import SETS as SETS
from gvp_book.experiments.photographs import photographed as photographed
from gvp_book.experiments.reach import reach_jobs as reach_jobs
from gvp_book.experiments.things import THINGS as THINGS
