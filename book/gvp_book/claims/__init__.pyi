"""The names of the room, one a line: for type checkers, editors, and ``gvp_lib.lazy``."""

from gvp_book.claims.claim import Claim as Claim
from gvp_book.claims.claim import Found as Found
from gvp_book.claims.claim import Measured as Measured
from gvp_book.claims.claim import Rule as Rule
from gvp_book.claims.claim import Verdict as Verdict
from gvp_book.claims.listing import CLAIMS as CLAIMS
from gvp_book.claims.listing import Judged as Judged
from gvp_book.claims.listing import Results as Results
from gvp_book.claims.listing import claims_table as claims_table
from gvp_book.claims.listing import judge as judge
from gvp_book.claims.listing import judge_all as judge_all
from gvp_book.claims.listing import summary as summary
from gvp_book.claims.listing import summary_table as summary_table
