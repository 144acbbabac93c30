"""Why a picture is as it is, and what it cost."""
