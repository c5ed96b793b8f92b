"""`serve`: posted frames are answered with their grasps, and no request ends the server."""

import base64
import http.client
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from examples import post_frame
from pipelines import serve
from pipelines.configs import ServeConfig
from pipelines.errors import SymgraspError
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.inference.models import WEIGHTS
from symgrasp.detector import GraspDetector
from symgrasp.frame_input import frame_of
from symgrasp_cli.app import app
from tests.grasp_files.exports.gripper_toys import random_result

testclient = pytest.importorskip("fastapi.testclient", reason="the extra serve")
uvicorn = pytest.importorskip("uvicorn", reason="the extra serve")
anyio = pytest.importorskip("anyio", reason="the extra serve")
http_app = pytest.importorskip("pipelines.serving.http_app", reason="the extra serve")
http_server = pytest.importorskip("pipelines.serving.http_server", reason="the extra serve")
RG2, ROOT = load_gripper("rg2"), Path(__file__).parents[2]
RESULT = random_result(np.random.default_rng(0), 9, "x")
LIGHT = ["--set", "regions=geometric", "--set", "method=planar"]
DEPTH = np.full((12, 16), 700, np.uint16)
COLOR = np.zeros((12, 16, 3), np.uint8)


def client_of(detect=lambda *_args, **_options: RESULT, **settings):
    return testclient.TestClient(serve.app_of(detect, RG2, ServeConfig(**settings)))


def png(array) -> str:
    data = BytesIO()
    Image.fromarray(array).save(data, "PNG")
    return base64.b64encode(data.getvalue()).decode()


def raw(array) -> dict:
    text = base64.b64encode(array.tobytes()).decode()
    return {"shape": list(array.shape), "dtype": str(array.dtype), "data": text}


def post(**changes) -> dict:
    return {"color": png(COLOR), "depth": png(DEPTH), "intrinsics": [9, 9, 8, 6], **changes}


@pytest.mark.parametrize("option", ["detector", "network", "plane-critic", "grasp-critic"])
def test_weights_of_another_model_are_refused_before_the_server_listens(option):
    run = CliRunner().invoke(
        app, ["serve", f"--{option}", str(WEIGHTS / "axis_critic.safetensors")]
    )
    assert run.exit_code == 1
    assert "axis_critic.safetensors" in run.stderr


@pytest.mark.parametrize("fault", [None, "table of this frame is not found"])
def test_loops_are_compiled_before_the_server_listens(fault, monkeypatch):
    steps = []

    def detect(_self, color, *_arrays, workspace):
        steps.append((color.shape[2], min(workspace)))
        if fault:
            raise SymgraspError(fault)

    def listen(_config):
        steps.append("listening")
        raise SymgraspError("the port is in use")

    monkeypatch.setattr(GraspDetector, "frame_result", detect)
    monkeypatch.setattr(serve, "listening", listen)
    box = ["--set", "limits.box=[0,0,0,1,1,1]"]  # without a grasp, most loops would not run
    run = CliRunner().invoke(app, ["serve", *LIGHT, *box])
    assert (steps, run.exit_code) == ([(3, -9), "listening"], 1)
    assert (f"fails: {fault}" in run.stderr) == bool(fault)


def test_a_frame_is_answered_with_its_grasps_best_first():
    answer = client_of().post("/grasps", json=post(name="frame 7"))
    assert answer.status_code == 200
    content = answer.json()
    assert (content["name"], content["gripper"]["name"]) == ("frame 7", RG2.name)
    scores = [grasp["rank_score"] for grasp in content["grasps"]]
    assert scores == sorted(scores, reverse=True)
    assert len(scores) > 3
    assert np.shape(content["grasps"][0]["pose"]) == (4, 4)


@pytest.mark.parametrize("as_posted", [png, raw])
def test_pictures_and_raw_arrays_reach_the_detector_unchanged(as_posted):
    seen = {}

    def detect(color, depth, **options):
        seen.update(color=color, depth=depth, **options)
        return RESULT

    rng = np.random.default_rng(1)
    color = rng.integers(0, 255, (12, 16, 3), np.uint8)
    depth = rng.integers(300, 2000, (12, 16)).astype(np.uint16)
    frame = post(color=as_posted(color), depth=as_posted(depth), workspace=[0, 0, 0, 1, 1, 1])
    assert client_of(detect).post("/grasps", json=frame).status_code == 200
    np.testing.assert_array_equal(seen["color"], color)
    np.testing.assert_array_equal(seen["depth"], depth)
    assert (seen["intrinsics"], seen["workspace"]) == ([9, 9, 8, 6], [0, 0, 0, 1, 1, 1])


def test_optional_keys_may_be_null():
    optional = dict.fromkeys(["depth_units_per_metre", "workspace", "masks", "name"])
    answer = client_of().post("/grasps", json=post(**optional))
    assert (answer.status_code, answer.json()["name"]) == (200, "")


def test_base64_in_lines_is_read():
    lines = {key: base64.encodebytes(base64.b64decode(post()[key])).decode() for key in ("color",)}
    assert client_of().post("/grasps", json=post(**lines)).status_code == 200


def bomb(side=1200) -> str:
    return png(np.zeros((side, side), np.uint16))


@pytest.mark.parametrize(
    ("frame", "sentence"),
    [
        ([1], "body is a list"),
        ({}, "without color"),
        (post(depth=None), "without depth"),
        (post(dpeth=1), "'dpeth'"),
        (post(color="not base64!"), "no base64"),
        (post(color=png(COLOR)[:60]), "no such picture"),
        (post(color=base64.b64encode(b"GIF89a").decode()), "no such picture; it must be PNG"),
        (post(depth=png(COLOR)), "a PNG of 16 bits"),
        (post(depth=bomb()), "of 1440000 pixels"),
        (post(depth=bomb(14_000)), "at most 1000000"),
        (post(depth={**raw(DEPTH), "dtype": "object"}), "uint16 or float32"),
        (post(depth={**raw(DEPTH), "shape": [10**9, 10**9]}), "height, width"),
        (post(depth={**raw(DEPTH), "shape": [12, 15]}), "384 bytes"),
        (post(color=png(DEPTH)), "color is of mode I;16; it must be of 8 bits per channel"),
        (post(depth={**raw(DEPTH), "data": "AA=="}), "is 1 byte; it must be 384"),
        (post(depth={**raw(DEPTH), "shape": [True, True]}), "height, width"),
        (post(name=3), "no short text"),
        (post(name="x" * 1001), "at most 1000 characters"),
    ],
)
def test_requests_without_a_valid_frame_are_reported_in_one_sentence(frame, sentence):
    answer = client_of(max_pixels=1_000_000).post("/grasps", json=frame)
    assert answer.status_code == 400
    assert sentence in answer.json()["error"]
    assert "\n" not in answer.json()["error"]


def test_a_name_with_half_a_character_is_reported_in_one_sentence():
    body, headers = json.dumps(post(name="\ud800")), {"content-type": "application/json"}
    answer = client_of().post("/grasps", content=body, headers=headers)
    assert answer.status_code == 400
    assert "surrogates not allowed" in answer.json()["error"]


@pytest.mark.parametrize("units", [[1000], "1000", True, {"x": 1000}, float("nan")])
def test_units_that_are_not_a_number_are_reported_in_one_sentence(units):
    client = client_of(lambda color, depth, **options: frame_of(color, depth, [9] * 4, units))
    answer = client.post("/grasps", json=post())
    assert answer.status_code == 400
    assert "depth_units_per_metre" in answer.json()["error"]


def test_sizes_types_and_depths_of_bodies_have_limits():
    client = client_of(max_bytes=5000)
    head = {"Content-Type": "application/json"}
    assert client.post("/grasps", content=b"x" * 6000, headers=head).status_code == 413
    parts = (b"x" * 1000 for _ in range(6))  # no length is declared
    assert client.post("/grasps", content=parts, headers=head).status_code == 413
    assert client.post("/grasps", content=b"[" * 4000, headers=head).status_code == 400
    plain = {"Content-Type": "text/plain"}
    refused = client.post("/grasps", content=b"{}", headers=plain)
    assert refused.status_code == 415
    sentence = "the Content-Type is text/plain; it must be application/json"
    assert refused.json() == {"error": sentence}


@pytest.mark.parametrize("kind", ["Application/JSON", "application/json; charset=utf-8"])
def test_content_types_are_read_in_any_case_and_with_parameters(kind):
    body, head = json.dumps(post()), {"Content-Type": kind}
    assert client_of().post("/grasps", content=body, headers=head).status_code == 200


def test_monitors_may_ask_for_the_health_with_head():
    client = client_of()
    answer = client.head("/health")
    assert answer.status_code == 200
    assert answer.headers["Content-Length"] == client.get("/health").headers["Content-Length"]


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [("GET", "/grasps", 405), ("POST", "/", 404), ("PUT", "/x", 404), ("POST", "/grasps/", 404)],
)
def test_other_requests_are_told_which_are_answered(method, path, status):
    answer = client_of().request(method, path)
    sentence = f"{method} {path} is not answered; POST /grasps and GET /health are"
    assert (answer.status_code, answer.json()) == (status, {"error": sentence})


def posted_by_hand(server, receive, kind):
    """Return the status of a post whose body comes from `receive`, and the counts afterwards."""
    sent = []
    head = [(b"content-type", kind.encode())]
    scope = {"type": "http", "method": "POST", "path": "/grasps", "headers": head}
    scope |= {"query_string": b"", "root_path": "", "scheme": "http", "http_version": "1.1"}

    async def send(message):
        sent.append(message)

    anyio.run(server, scope, receive, send)
    return sent[0]["status"], testclient.TestClient(server).get("/health").json()


@pytest.mark.parametrize(("kind", "status"), [("application/json", 408), ("text/plain", 415)])
def test_a_client_that_goes_silent_in_its_post_does_not_wait_for_ever(kind, status, monkeypatch):
    monkeypatch.setattr(http_app, "LONGEST_SILENCE", 0.1)
    begin = iter([{"type": "http.request", "body": b'{"color": "abc', "more_body": True}])

    async def receive():
        for message in begin:
            return message
        await anyio.sleep(20)
        raise AssertionError("the server still waits")

    server = serve.app_of(lambda *_args, **_options: RESULT, RG2, ServeConfig())
    answered, health = posted_by_hand(server, receive, kind)
    assert answered == status
    assert (health["waiting"], health["refused"]) == (0, 1)


def test_a_slow_client_has_the_same_time_for_each_part_of_its_body():
    body, limits = json.dumps(post()).encode(), []
    parts = [body[:50], body[50:90], body[90:]]

    async def receive():
        await anyio.sleep(0.01)
        limits.append(anyio.current_effective_deadline())
        more = len(limits) < len(parts)
        return {"type": "http.request", "body": parts[len(limits) - 1], "more_body": more}

    server = serve.app_of(lambda *_args, **_options: RESULT, RG2, ServeConfig())
    assert posted_by_hand(server, receive, "application/json")[0] == 200
    assert limits == sorted(set(limits))


def test_a_client_that_sends_its_body_in_a_trickle_does_not_hold_a_place_for_ever(monkeypatch):
    monkeypatch.setattr(http_app, "LONGEST_BODY", 0.1)

    async def receive():
        await anyio.sleep(0.01)
        return {"type": "http.request", "body": b" ", "more_body": True}

    server = serve.app_of(lambda *_args, **_options: RESULT, RG2, ServeConfig())
    answered, health = posted_by_hand(server, receive, "application/json")
    assert answered == 408
    assert (health["waiting"], health["refused"]) == (0, 1)


@pytest.mark.skipif(sys.platform != "linux", reason="systems differ in the options of sockets")
def test_connections_of_clients_that_lost_their_network_end():
    (listener,) = serve.listening(ServeConfig(port=0))
    with listener, socket.create_connection(listener.getsockname()):
        connection, _ = listener.accept()
        with connection:
            assert connection.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE) == 1
            assert connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE) == 30


def test_a_port_in_use_is_reported_in_one_sentence():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(SymgraspError, match=rf"--port {port} .* on \(Address already in use\)"):
            serve.listening(ServeConfig(port=port))
    for each in serve.listening(ServeConfig(port=port)):
        each.close()
    with pytest.raises(SymgraspError, match=r"--host no.invalid .*choose another"):
        serve.listening(ServeConfig(host="no.invalid"))


@pytest.mark.parametrize("host", [".local", "a..b", 64 * "a"])
def test_a_text_that_is_no_name_of_a_host_is_reported_in_one_sentence(host):
    with pytest.raises(SymgraspError, match=r"\(this is no name of a host\); choose another"):
        serve.listening(ServeConfig(host=host))


def test_addresses_that_the_machine_lacks_are_left_out(monkeypatch):
    """Some hosts name an IPv6 address for `localhost` and have no IPv6."""
    kind = socket.SOCK_STREAM, 6, ""
    found = [
        (socket.AF_INET6, *kind, ("2001:db8::1", 0, 0, 0)),
        (socket.AF_INET, *kind, ("127.0.0.1", 0)),
    ]
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_args, **_kwargs: found)
    (opened,) = serve.listening(ServeConfig(host="localhost"))
    assert opened.family == socket.AF_INET
    opened.close()


REFUSING = """
from pipelines import serve
from pipelines.configs import ServeConfig
from pipelines.grasp_files.gripper_files import load_gripper

config = ServeConfig(port=0, max_bytes=20_000_000)
sockets = serve.listening(config)
print(sockets[0].getsockname()[1], flush=True)
serve.run(serve.app_of(None, load_gripper("rg2"), config), config, sockets)
"""


@pytest.mark.parametrize(
    ("kind", "size", "status"),
    [("application/json", 60_000_000, 413), ("text/plain", 15_000_000, 415)],
)
def test_a_client_that_sends_all_before_it_reads_gets_the_refusal(kind, size, status):
    command = [sys.executable, "-c", REFUSING]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as server:
        try:
            url = f"http://127.0.0.1:{int(server.stdout.readline())}/grasps"
            request = urllib.request.Request(url, b"x" * size, {"Content-Type": kind})
            with pytest.raises(urllib.error.HTTPError) as refused:
                urllib.request.urlopen(request, timeout=60)
            with refused.value as answer:
                assert answer.code == status
                assert "error" in json.load(answer)
        finally:
            server.terminate()


def test_errors_of_a_frame_are_reported_in_one_sentence_and_internal_faults_are_hidden():
    def refuse(*_args, **_options):
        raise SymgraspError("depth is in millimetres")

    def fail(*_args, **_options):
        raise RuntimeError("secret")

    answer = client_of(refuse).post("/grasps", json=post())
    assert (answer.status_code, answer.json()["error"]) == (400, "depth is in millimetres")
    answer = client_of(fail).post("/grasps", json=post())
    assert answer.status_code == 500
    assert "secret" not in answer.text


class HeldDetector:
    """A detector that begins each frame at once and answers when `go` is set."""

    def __init__(self):
        self.begun, self.go = threading.Semaphore(0), threading.Event()

    def __call__(self, *_args, **_options):
        self.begun.release()
        assert self.go.wait(60)
        return RESULT


def test_eight_clients_at_once_are_answered_and_clients_beyond_the_queue_are_refused():
    detect = HeldDetector()
    with client_of(detect, parallel=4, max_waiting=8) as client, ThreadPoolExecutor(8) as pool:
        answers = [pool.submit(client.post, "/grasps", json=post()) for _ in range(8)]
        for _ in range(4):
            assert detect.begun.acquire(timeout=20)
        while client.get("/health").json()["waiting"] < 8:
            time.sleep(0.01)
        assert client.post("/grasps", json=post()).status_code == 503
        detect.go.set()
        assert [each.result().status_code for each in answers] == [200] * 8
        health = client.get("/health").json()
    assert (health["answered"], health["refused"], health["waiting"]) == (8, 1, 0)


def test_a_post_whose_answer_is_expected_too_late_is_refused_until_it_would_be_in_time():
    detect = HeldDetector()
    times = http_app.FrameTimes(parallel=2, mean=7.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(http_app, "FrameTimes", lambda _parallel: times)
        server = client_of(detect, parallel=2, max_wait=14.0)
    with server as client, ThreadPoolExecutor(4) as pool:
        answers = [pool.submit(client.post, "/grasps", json=post()) for _ in range(4)]
        for _ in range(2):
            assert detect.begun.acquire(timeout=20)
        while client.get("/health").json()["waiting"] < 4:
            time.sleep(0.01)
        refused = client.post("/grasps", json=post())  # of 7 s each, two pairs are ahead
        assert (refused.status_code, refused.headers["Retry-After"]) == (503, "7")
        sentence = "the server has 4 frames to answer first; post again in 7 s"
        assert refused.json() == {"error": sentence}
        detect.go.set()
        assert [each.result().status_code for each in answers] == [200] * 4
        times.mean = 7.0  # posts that do not wait are never refused, or the mean would stay
        assert client.post("/grasps", json=post()).status_code == 200
    assert times.mean < 7.0


def test_the_expected_time_until_an_answer_follows_the_latest_frames():
    times = http_app.FrameTimes(parallel=2)
    assert times.until_answer(100) == 0.0  # nothing is known before the first frame
    times.note(1.0)
    assert [times.until_answer(ahead) for ahead in range(5)] == [0.0, 0.0, 2.0, 2.0, 3.0]
    for _ in range(50):
        times.note(3.0)
    assert times.until_answer(2) == pytest.approx(6.0, rel=0.01)


@contextmanager
def served(detect, **settings):
    """Serve in a thread; yields the port."""
    sockets = serve.listening(config := ServeConfig(port=0, **settings))
    server = http_server.GraspServer(serve.app_of(detect, RG2, config), config)
    with ThreadPoolExecutor(1) as pool:
        ending = pool.submit(server.run, sockets)
        try:
            yield sockets[0].getsockname()[1]
        finally:
            server.should_exit = True
            ending.result()


def counts_at(port):
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/health", timeout=60) as answer:
        return json.load(answer)


def ends_by_the_server(connection) -> bool:
    connection.settimeout(20)
    return connection.recv(1) == b""


def answers(connection) -> bool:
    connection.settimeout(20)
    connection.sendall(b"GET /health HTTP/1.1\r\nHost: x\r\n\r\n")
    return connection.recv(100).startswith(b"HTTP/1.1 200")


def test_clients_that_connect_and_send_nothing_do_not_block_others():
    with served(None, max_waiting=1) as port, ExitStack() as open_ones:
        silent = [
            open_ones.enter_context(socket.create_connection(("127.0.0.1", port))) for _ in range(8)
        ]
        silent[0].sendall(b"POST /grasps HTTP/1.1\r\nHost:")
        assert counts_at(port)["status"] == "ok"
        assert answers(silent[1])


@pytest.mark.parametrize("begun", [b"", b"POST /grasps HTTP/1.1\r\nHost:"])
def test_a_connection_without_a_request_ends(begun, monkeypatch):
    monkeypatch.setattr(http_server, "LONGEST_SILENCE", 0.3)
    with served(None) as port, socket.create_connection(("127.0.0.1", port)) as silent:
        silent.sendall(begun)
        assert ends_by_the_server(silent)


def test_a_half_sent_post_does_not_delay_the_end(monkeypatch):
    monkeypatch.setattr(http_server, "LAST_UPLOADS", 0.1)
    head = "POST /grasps HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\n"
    with ExitStack() as outlasting:
        with served(None) as port:
            uploading = socket.create_connection(("127.0.0.1", port))
            outlasting.enter_context(uploading)
            uploading.sendall(f"{head}Content-Length: 100\r\n\r\n{{".encode())
            while not counts_at(port)["waiting"]:
                time.sleep(0.01)
        assert ends_by_the_server(uploading)


def test_of_too_many_connections_those_that_are_silent_for_longest_end(monkeypatch):
    monkeypatch.setattr(http_server, "MOST_CONNECTIONS", 3)
    detect = HeldDetector()
    with served(detect) as port, ExitStack() as stack, ThreadPoolExecutor(1) as pool:
        url, head = f"http://127.0.0.1:{port}/grasps", {"Content-Type": "application/json"}
        request = urllib.request.Request(url, json.dumps(post()).encode(), head)
        busy = pool.submit(urllib.request.urlopen, request)
        assert detect.begun.acquire(timeout=60)
        opened = []
        for _ in range(3):
            opened.append(stack.enter_context(socket.create_connection(("127.0.0.1", port))))
            time.sleep(0.3)  # the server looks every 0.1 s
        assert ends_by_the_server(opened[0])
        assert answers(opened[2])
        detect.go.set()
        assert stack.enter_context(busy.result()).status == 200


@pytest.mark.parametrize("side", [12, 400])  # uvicorn stops reading after bodies of 64 kB
def test_frames_of_clients_that_have_gone_are_not_processed(side):
    detect = HeldDetector()
    body = json.dumps(post(color=raw(np.zeros((side, side, 3), np.uint8)))).encode()
    head = {"Content-Type": "application/json"}
    with served(detect, parallel=1) as port, ThreadPoolExecutor(1) as pool:
        url = f"http://127.0.0.1:{port}/grasps"
        patient = pool.submit(urllib.request.urlopen, urllib.request.Request(url, body, head))
        assert detect.begun.acquire(timeout=60)
        gone = http.client.HTTPConnection("127.0.0.1", port)
        gone.request("POST", "/grasps", body, head)
        while counts_at(port)["waiting"] < 2:
            time.sleep(0.01)
        gone.close()
        detect.go.set()
        patient.result().close()
        while counts_at(port)["waiting"]:
            time.sleep(0.01)
        counts = counts_at(port)
    assert (counts["answered"], counts["refused"]) == (1, 1)
    assert not detect.begun.acquire(blocking=False)


def test_the_command_answers_the_example_and_ends_with_sigterm(tmp_path):
    command = [sys.executable, "-m", "symgrasp", "serve", *LIGHT, "--port", "18765"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen(command, cwd=tmp_path, env=environment, stderr=subprocess.PIPE) as server:
        try:
            url = "http://127.0.0.1:18765"
            for _ in range(1200):
                try:
                    urllib.request.urlopen(f"{url}/health", timeout=1).close()
                    break
                except OSError:
                    assert server.poll() is None, server.stderr.read()
                    time.sleep(0.1)
            files = [WEIGHTS / "frames" / f"table_1_{end}" for end in ("color.png", "depth.png")]
            camera = json.loads((WEIGHTS / "frames" / "table_1_camera.json").read_text())
            (tmp_path / "camera.json").write_text(json.dumps(camera))
            answer = post_frame.grasps_of(*files, tmp_path / "camera.json", f"{url}/grasps")
            assert len(answer["grasps"]) > 3
            assert [grasp["rank_in_frame"] for grasp in answer["grasps"]][:2] == [0, 1]
            wrong = [files[0], files[0], tmp_path / "camera.json", f"{url}/grasps"]
            command = [sys.executable, post_frame.__file__, *map(str, wrong)]
            refused = subprocess.run(command, capture_output=True, text=True, check=False)
            assert refused.returncode == 1
            assert refused.stderr.startswith('{"error":"depth')
        finally:
            server.send_signal(signal.SIGTERM)
        assert server.wait(timeout=30) == 143
        lines = server.stderr.read().decode().splitlines()
        assert lines[-1] == "error: stopped by SIGTERM; frames in progress are answered"
        assert not any("Traceback" in line for line in lines)


SLOW = """
import sys, time
from pipelines import serve
from pipelines.configs import ServeConfig
from pipelines.ending import end_on_signals
from pipelines.grasp_files.gripper_files import load_gripper

def detect(*_args, **_options):
    print("begun", flush=True)
    time.sleep(60)

end_on_signals()
config = ServeConfig(port=int(sys.argv[1]), grace=int(sys.argv[2]))
serve.run(serve.app_of(detect, load_gripper("rg2"), config), config, serve.listening(config))
"""


@pytest.mark.parametrize(("grace", "signals"), [(1, 1), (50, 2)])
def test_a_frame_that_outlasts_the_grace_or_a_second_signal_ends_in_one_sentence(grace, signals):
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        port = found.getsockname()[1]
    command = [sys.executable, "-c", SLOW, str(port), str(grace)]
    pipe = subprocess.PIPE
    with (
        subprocess.Popen(command, cwd=ROOT, stdout=pipe, stderr=pipe, text=True) as server,
        ThreadPoolExecutor(1) as pool,
    ):
        lost = pool.submit(patiently_post, f"http://127.0.0.1:{port}/grasps", server)
        assert server.stdout.readline() == "begun\n", server.stderr.read()
        for _ in range(signals):
            server.send_signal(signal.SIGTERM)
            time.sleep(0.5)
        assert server.wait(timeout=20) == 143
        printed = server.stderr.read()
        assert isinstance(lost.exception(), OSError | http.client.HTTPException)
    assert printed == (
        f"error: stopped by SIGTERM; frames in progress that take over {grace} s are lost\n"
    )


def patiently_post(url, server):
    body = json.dumps(post()).encode()
    while server.poll() is None:
        request = urllib.request.Request(url, body, {"Content-Type": "application/json"})
        try:
            urllib.request.urlopen(request, timeout=60).close()
        except urllib.error.URLError as error:
            if not isinstance(error.reason, ConnectionRefusedError):
                raise
            time.sleep(0.1)
