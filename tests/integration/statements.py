"""How a test drives an editor in a process of its own: each line of stdin is a JSON string of Python statements; the answer
is a JSON line with the value of `result`, or with the error."""

import json
import sys
import traceback


def answer_all(names: dict) -> None:
    """Executes the statements with `names`, until stdin ends. The first answer says that the editor is ready."""
    print("{}", flush=True)
    for line in sys.stdin:
        names.pop("result", None)
        try:
            exec(json.loads(line), names)
            answer = {"value": names.get("result")}
        except BaseException:
            answer = {"error": traceback.format_exc()}
        print(json.dumps(answer), flush=True)
