from updating.commands.demo import demo_command
from updating.commands.diagnose import diagnose_command, next_test_command
from updating.commands.ema import ema_command, pick_command
from updating.commands.fit import fit_command
from updating.commands.model import effects_command, model_command, simulate_command
from updating.commands.new import new_command
from updating.commands.report import make_report, open_command, report_command, view_command
from updating.commands.update import update_command

__all__ = [
    "demo_command",
    "diagnose_command",
    "effects_command",
    "ema_command",
    "fit_command",
    "make_report",
    "model_command",
    "new_command",
    "next_test_command",
    "open_command",
    "pick_command",
    "report_command",
    "simulate_command",
    "update_command",
    "view_command",
]
