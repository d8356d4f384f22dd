# SPDX-License-Identifier: BSD-3-Clause
"""How the set-up installs and builds: where uv looks, what pip does without it, what is generated, what is shown."""

import hashlib
import json
import os
import pwd
import re
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import NoReturn, cast

import pytest

ROOT = Path(__file__).parents[3]
TIMEOUT_S = 120

sys.path.append(str(ROOT / 'tools'))
from workspace import terminal, test_run  # noqa: E402
from workspace.errors import CommandError, WorkspaceError  # noqa: E402
from workspace.installer import Installer, bundled_pip, cache_variables, progress_of_uv, uv_variables  # noqa: E402
from workspace.layout import Layout, Package  # noqa: E402
from workspace.terminal import run_logged, step  # noqa: E402
from workspace.underlay import WHEELS, with_spaces  # noqa: E402
from workspace.workspace import Workspace  # noqa: E402

LAYOUT = with_spaces(Layout(ROOT), os.environ)
BARE = {'PATH': os.defpath, 'PIP_CONFIG_FILE': os.devnull}


def configuration_of_pip(file: Path, **environment: str) -> str:
    """Return what pip itself says about a configuration file and its variables."""
    wheel = bundled_pip()
    assert wheel is not None
    ended = subprocess.run(
        [sys.executable, wheel / 'pip', 'config', 'list'],
        env={**BARE, 'PIP_CONFIG_FILE': str(file), **environment},
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=True,
    )
    return ended.stdout


def test_uv_looks_where_pip_is_told_to_look(tmp_path: Path) -> None:
    file = tmp_path / 'pip.conf'
    file.write_text(
        '[global]\nindex-url = https://mirror.example/simple\nfind-links = /from/file\ntimeout = 60\n'
        '[install]\ntimeout = 90\nextra-index-url = https://a.example\n  https://b.example\n',
        encoding='utf-8',
    )
    configuration = configuration_of_pip(file, PIP_FIND_LINKS='/wheels /more', PIP_CERT='/ca.pem', PIP_NO_COLOR='1')
    own = {'UV_DEFAULT_INDEX': 'https://own.example'}
    of_the_computer = uv_variables(configuration_of_pip(tmp_path / 'none'), own)
    assert uv_variables(configuration, own) == {
        **of_the_computer,
        'SSL_CERT_FILE': '/ca.pem',
        'UV_FIND_LINKS': '/wheels,/more',
        'UV_HTTP_TIMEOUT': '90',
        'UV_INDEX': 'https://a.example https://b.example',
        'UV_INDEX_STRATEGY': 'unsafe-best-match',
    }


def test_a_setting_that_only_pip_knows_is_named() -> None:
    with pytest.raises(WorkspaceError, match='pip is configured with no-binary'):
        uv_variables(":env:.no-binary=':all:'\n", {})


def test_a_home_that_is_no_directory_is_no_place_for_downloads(tmp_path: Path) -> None:
    file = tmp_path / 'file'
    file.touch()
    spare = {'XDG_CACHE_HOME': '/spare'}
    assert cache_variables({'HOME': str(file)}, Path('/spare')) == spare
    assert cache_variables({'HOME': str(tmp_path), 'XDG_CACHE_HOME': f'{file}/cache'}, Path('/spare')) == spare
    assert cache_variables({'HOME': str(tmp_path)}, Path('/spare')) == {}


def test_who_has_no_home_has_a_place_for_downloads(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_account(number: int) -> NoReturn:
        raise KeyError(number)  # as for the number of a user that /etc/passwd does not have

    monkeypatch.delenv('HOME', raising=False)
    monkeypatch.setattr(pwd, 'getpwuid', no_account)
    assert cache_variables({}, Path('/spare')) == {'XDG_CACHE_HOME': '/spare'}


def pins(file: str) -> dict[str, str]:
    """Return what a file of requirements or a lock pins: versions by names."""
    text = (ROOT / 'tools' / file).read_text(encoding='utf-8')
    found = re.findall(r'^([A-Za-z0-9_.-]+)(?:\[[^]]*\])?==([^\s;\\]+)', text, re.MULTILINE)
    return {re.sub(r'[-_.]+', '-', name).lower(): version for name, version in found}


@pytest.mark.parametrize('distribution', WHEELS)
def test_the_locks_have_what_is_required_at_its_version_and_hashes_of_all(distribution: str) -> None:
    locks = ('lock.txt', f'lock-{distribution}.txt')
    general, of_ros = map(pins, locks)
    assert {name: general[name] for name in general.keys() & of_ros.keys()}.items() <= of_ros.items()
    for file in ('requirements.txt', f'requirements-{distribution}.txt', 'requirements-dev.txt'):
        required = pins(file)
        assert required and required.items() <= (general | of_ros).items(), file
    for file in (*locks, 'requirements-uv.txt', 'requirements-cmake.txt'):
        _, *entries = re.split(r'^(?=[A-Za-z0-9])', (ROOT / 'tools' / file).read_text(encoding='utf-8'), flags=re.M)
        assert [entry for entry in entries if '--hash=sha256:' not in entry] == []


@pytest.mark.parametrize('is_right', [True, False], ids=['as locked', 'another file'])
def test_without_uv_pip_installs_alone_and_nothing_but_what_the_hashes_say(
    is_right: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Where no index has uv: on a machine without network, with a directory of wheels."""
    with zipfile.ZipFile(tmp_path / 'small-1.0-py3-none-any.whl', 'w') as wheel:
        wheel.writestr('small.py', '')
        wheel.writestr('small-1.0.dist-info/METADATA', 'Metadata-Version: 2.1\nName: small\nVersion: 1.0\n')
        wheel.writestr('small-1.0.dist-info/WHEEL', 'Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n')
        wheel.writestr('small-1.0.dist-info/RECORD', '')
    wheel_hash = hashlib.sha256((tmp_path / 'small-1.0-py3-none-any.whl').read_bytes()).hexdigest()
    locked = wheel_hash if is_right else '0' * 64
    for name, text in (('lock', f'small==1.0 --hash=sha256:{locked}'), ('uv', f'uv==0.0.1 --hash=sha256:{locked}')):
        (tmp_path / name).write_text(text, encoding='utf-8')
    environment = {**BARE, 'PIP_NO_INDEX': '1', 'PIP_FIND_LINKS': str(tmp_path)}
    subprocess.run([sys.executable, '-m', 'venv', '--without-pip', tmp_path / 'venv'], check=True, timeout=TIMEOUT_S)
    python = tmp_path / 'venv' / 'bin' / 'python'

    def run(command: Sequence[str | Path], log: str, what: str, shown: terminal.Step, **options: object) -> None:
        options['environment'] = {**environment, **options.pop('variables', {})}  # type: ignore[dict-item]
        run_logged(command, tmp_path / log, what=what, shown=shown, directory=tmp_path, **options)  # type: ignore[arg-type]

    installer = Installer(python, environment, run)
    if not is_right:
        with pytest.raises(CommandError):
            installer.install([tmp_path / 'lock'], tmp_path / 'uv')
        assert 'DO NOT MATCH THE HASHES' in (tmp_path / 'setup-install.log').read_text(encoding='utf-8')
        return
    installer.install([tmp_path / 'lock'], tmp_path / 'uv')
    subprocess.run([python, '-c', 'import small'], check=True, timeout=TIMEOUT_S)
    assert (
        f'continuing without uv, with pip alone, which takes longer (see {tmp_path}/setup-uv.log)'
        in capsys.readouterr().out
    )


def test_modules_are_compiled_where_python_is_told_to_write_none(tmp_path: Path) -> None:
    """By a step that counts them: a module that is no Python, as some packages bring along, stops nothing."""
    python = tmp_path / 'bin' / 'python'
    python.parent.mkdir()
    python.symlink_to(sys.executable)
    site_packages = tmp_path / 'lib' / 'python3.11' / 'site-packages'
    site_packages.mkdir(parents=True)
    for name, text in (('one', ''), ('other', ''), ('template', '<no Python>')):
        (site_packages / f'{name}.py').write_text(text, encoding='utf-8')
    notes = []

    def run(command: Sequence[str | Path], log: str, what: str, shown: terminal.Step, **options: object) -> None:
        progress = cast(Callable[[Path], str], options['progress'])
        environment = {**BARE, 'PYTHONDONTWRITEBYTECODE': '1'}
        file = tmp_path / log
        run_logged(command, file, what=what, shown=shown, directory=tmp_path, environment=environment)
        notes.append(progress(file))

    Installer(python, BARE, run)._compile_modules()
    assert notes == ['3 of 3 modules compiled']
    compiled = {file.name.partition('.')[0] for file in site_packages.rglob('*.pyc')}
    assert compiled == {'one', 'other'}


def test_a_full_disk_is_named(tmp_path: Path) -> None:
    log = tmp_path / 'log'
    log.write_text("cc1: error: writing to 'x.o': No space left on device\n", encoding='utf-8')
    error = CommandError('colcon build', 1, log, 'mend it')
    assert error.disk_was_full
    assert (error.message, error.remedy.split(',')[0]) == (
        'colcon build ended with exit code 1: the disk is full',
        'free disk space',
    )


@pytest.fixture
def generator_arguments(tmp_path: Path) -> Iterator[Path]:
    """Yield what CMake gave to the Python generator, for one of the interfaces, with another place for what is
    generated."""
    file = LAYOUT.build / 'flexbt_msgs' / 'rosidl_generator_py__arguments.json'
    if not file.exists():
        pytest.skip('flexbt_msgs was not built here')
    arguments = json.loads(file.read_text(encoding='utf-8'))
    arguments['idl_tuples'] = [one for one in arguments['idl_tuples'] if one.endswith('/BtExecute.idl')]
    arguments['output_dir'] = str(tmp_path)
    changed = tmp_path / 'arguments.json'
    changed.write_text(json.dumps(arguments), encoding='utf-8')
    yield changed


def test_generators_that_work_once_generate_the_same(generator_arguments: Path) -> None:
    generator = next(
        Path(prefix) / 'lib' / 'rosidl_generator_py' / 'rosidl_generator_py'
        for prefix in os.environ['AMENT_PREFIX_PATH'].split(os.pathsep)
        if (Path(prefix) / 'lib' / 'rosidl_generator_py').exists()
    )
    output = generator_arguments.parent

    def generated(**environment: str) -> dict[str, str]:
        subprocess.run(
            [sys.executable, generator, '--generator-arguments-file', generator_arguments, '--typesupport-impls', 'c'],
            env={**os.environ, 'PYTHONHASHSEED': '0', **environment},
            timeout=TIMEOUT_S,
            check=True,
        )
        files = [file for file in output.rglob('*') if file.suffix in ('.py', '.c')]
        found = {f'{file.relative_to(output)}': file.read_text(encoding='utf-8') for file in files}
        for name in found:
            (output / name).unlink()
        return found

    ordinary = generated(PYTHONPATH='')
    for _ in range(2):  # with what an earlier one kept, and with what this one keeps
        assert generated(PYTHONPATH=str(ROOT / 'tools' / 'interfaces')) == ordinary
    assert any('class BtExecute_Result' in text for text in ordinary.values())


def test_what_is_generated_is_installed_by_copies() -> None:
    """Links cost 20 ms a file, a third of a set-up, as ament makes each of them by a program of its own."""
    build = LAYOUT.build / 'flexbt_msgs'
    if not build.exists() or 'CMAKE_PROJECT_INCLUDE' not in (build / 'CMakeCache.txt').read_text(encoding='utf-8'):
        pytest.skip('flexbt_msgs was not built on the wheels')
    assert 'symlink' not in (build / 'cmake_install.cmake').read_text(encoding='utf-8')


def test_in_a_log_file_nothing_is_written_over(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(terminal, '_FIRST_NOTE_S', 0.0)
    log = tmp_path / 'uv.log'
    log.write_text('Resolved 3 packages in 1s\nDownloading a (30.0MiB)\nDownloading b (1.5GiB)\n Downloaded a\n')
    with step('packages') as shown:
        shown.show(progress_of_uv(log, 4, 0))
        shown.show('too soon for another')
        log.write_text('Resolved 3 packages in 1s\nPrepared 3 packages in 2s\n')
        assert progress_of_uv(log, 4, 2) == 'step 3 of 3: 2 of 3 packages installed'
    first, last = capsys.readouterr().out.splitlines()
    assert first == '  packages, 0 s: step 2 of 3: 30 of 1530 MB downloaded'
    assert last.startswith('  packages ....................... done  ')


def test_runs_of_tests_that_were_not_done_have_not_passed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Though each test in their results has passed: of one that ends early, one that hangs, and one of yesterday."""
    texts = {
        'early': 'def test_passes(): pass\ndef test_ends(): raise KeyboardInterrupt\n',
        'hangs': 'import signal\ndef test_passes(): pass\ndef test_hangs(): signal.pause()\n',
        'waits': 'def test_passes(): pass\n',
    }
    environment = {**os.environ, 'PYTEST_DISABLE_PLUGIN_AUTOLOAD': '1'}
    workspace = cast(Workspace, SimpleNamespace(layout=Layout(tmp_path), inside=list, environment=environment))
    runs = []
    for name, text in texts.items():
        file = tmp_path / name / 'test' / f'test_{name}.py'
        file.parent.mkdir(parents=True)
        file.write_text(text, encoding='utf-8')
        old = tmp_path / 'build' / name / 'pytest.xml'
        old.parent.mkdir(parents=True)
        old.write_text('<testsuite><testcase name="old"/></testsuite>', encoding='utf-8')
        runs.append(test_run._Run(workspace, Package(name, tmp_path / name, 'ament_python')))
    monkeypatch.setattr(test_run, 'LANES', 2)

    def ended_early() -> list[str]:
        assert runs[0]._process is not None
        runs[0]._process.wait(TIMEOUT_S)
        return []

    test_run._finish(runs, time.monotonic(), ended_early)
    tally = test_run.Tally()
    for one in runs:
        one.count(tally)
    said = '\n'.join(tally.failures)
    for name, ending in (('early', 'ended with exit code 2'), ('hangs', 'was stopped'), ('waits', 'did not begin')):
        assert f'FAILED {name}: pytest {ending}, see {tmp_path}/log/test-{name}.log' in said


def workspace_of(tmp_path: Path, files: dict[str, str]) -> Workspace:
    """Return a workspace with these files of Python, by their paths without the suffix."""
    for name, text in files.items():
        file = tmp_path / f'{name}.py'
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding='utf-8')
    environment = {**os.environ, 'PYTEST_DISABLE_PLUGIN_AUTOLOAD': '1'}
    return cast(Workspace, SimpleNamespace(layout=Layout(tmp_path), inside=list, environment=environment))


def finished(tmp_path: Path, tests: str) -> test_run._Run:
    """Return the run of a package with one module of tests, after its end."""
    workspace = workspace_of(tmp_path, {'a/test/test_a': tests})
    run = test_run._Run(workspace, Package('a', tmp_path / 'a', 'ament_python'))
    test_run._finish([run], time.monotonic() + TIMEOUT_S, list)
    return run


def test_a_test_with_the_mark_of_the_middleware_runs_on_it_and_every_other_one_in_one_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each of them once. Of a package of the middleware, only those with the other mark run in one process."""
    head = 'import pytest, sys\nIS_REAL = "flexbt_testing.one_process.plugin" not in sys.modules\n'
    mark = 'pytest.mark.dds("a socket")'
    texts = {
        'test_mixed': f'@{mark}\ndef test_real(): assert IS_REAL\ndef test_world(): assert not IS_REAL\n'
        f'@pytest.mark.parametrize("name", ["a", pytest.param("b", marks={mark})])\n'
        'def test_one_of_two(name): assert IS_REAL == (name == "b")\n',
        'deeper/test_module': f'pytestmark = {mark}\ndef test_real(): assert IS_REAL\n',
        'test_class': f'@{mark}\nclass TestSockets:\n  def test_real(self): assert IS_REAL\n',
        'test_none': 'def test_world(): assert not IS_REAL\n',
    }
    other = f'@pytest.mark.{"one_process"}\ndef test_world(): assert not IS_REAL\ndef test_real(): assert IS_REAL\n'
    files = {f'a/test/{name}': text for name, text in texts.items()} | {'b/test/test_b': other}
    workspace = workspace_of(tmp_path, {name: head + text for name, text in files.items()})
    monkeypatch.setattr(test_run, 'IS_SIMULATED', True)
    monkeypatch.setattr(test_run, 'IN_ONE_PROCESS', {'a': test_run.ONE_PROCESS})
    runs = test_run._runs_of(workspace, [Package(name, tmp_path / name, 'ament_python') for name in ('a', 'b')])
    test_run._finish(runs, time.monotonic() + TIMEOUT_S, list)
    tally = test_run.Tally()
    for one in runs:
        one.count(tally)
    assert (tally.passed, tally.failures) == (9, []), [one._log.read_text() for one in runs]
    names = [name for one in runs for name in test_run._passed(one._result_file)]
    assert len(names) == len(set(names)) == 9


@pytest.mark.parametrize('mark', ['dds', 'one_process'])
def test_the_marks_of_the_middleware_are_where_they_are_looked_for(mark: str) -> None:
    """They are text of a module of tests, so that no other module has to be imported to find them."""
    for package in Layout(ROOT).packages():
        for file in (package.path / 'test').rglob('*.py'):
            if re.search(rf'mark\.{mark}\b', file.read_text(encoding='utf-8')):
                assert str(file.relative_to(package.path)) in test_run._with_mark(package, mark), file


@pytest.mark.parametrize('most', [2, 1])
def test_few_tests_that_fail_get_a_second_try_and_what_failed_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, most: int
) -> None:
    monkeypatch.setattr(test_run, 'MOST_UNSTEADY', most)
    run = finished(
        tmp_path,
        'from pathlib import Path\n'
        'def run(name): Path(name).open("a").write("x"); return Path(name).read_text()\n'
        'def test_passes(): assert run("passes") == "x"\n'
        'def test_busy(): assert run("busy") == "xx"\n'
        'def test_fails(): assert run("fails") == ""\n',
    )
    test_run._try_again([run], time.monotonic() + TIMEOUT_S)
    tally = test_run.Tally()
    run.count(tally)
    told = [line.split(': ')[0].replace('a.test.test_a.test_', '') for line in (*tally.unsteady, *tally.failures)]
    if most == 1:
        assert told == ['FAILED busy', 'FAILED fails']
    else:
        assert told == ['UNSTEADY busy', 'FAILED fails']
        assert tally.summary() == '2 passed, 1 of them in a second try, 1 failed, 0 skipped'
    assert (tmp_path / 'a' / 'passes').read_text() == 'x', 'what passed is not run again'


def test_tests_that_hang_begin_anew_once_and_leave_their_stacks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(test_run, 'LONGEST_SILENCE', 20.0)
    run = finished(
        tmp_path,
        'import threading\n'
        'from pathlib import Path\n'
        'def run(name): Path(name).open("a").write("x"); return Path(name).read_text()\n'
        'def test_passes(): run("passes")\n'
        'def test_hangs_once(): run("hangs") == "xx" or threading.Event().wait()\n',
    )
    tally = test_run.Tally()
    run.count(tally)
    assert [line.split(':')[0] for line in tally.unsteady] == ['UNSTEADY a']
    assert (tally.passed, tally.failures) == (2, [])
    assert 'in test_hangs_once' in run._log.read_text()
    assert (tmp_path / 'a' / 'passes').read_text() == 'xx'


@pytest.mark.parametrize('is_ci', [False, True])
def test_in_continuous_integration_only_known_reasons_skip_a_test(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_ci: bool
) -> None:
    (tmp_path / 'pytest.xml').write_text(
        '<testsuites><testcase classname="a" name="runs"/>'
        '<testcase classname="a" name="known"><skipped message="Nav2 is not at hand"/></testcase>'
        '<testcase classname="a" name="whole"><skipped message="collection skipped">(1, "FLEXBT_ACCELERATION=0")'
        '</skipped></testcase><testcase classname="a" name="lacks"><skipped message="needs tmux"/></testcase>'
        '</testsuites>'
    )
    monkeypatch.delenv('CI', raising=False)
    if is_ci:
        monkeypatch.setenv('CI', 'true')
    tally = test_run.Tally()
    test_run._count(tmp_path / 'pytest.xml', 'a', '', tally)
    assert (tally.passed, tally.skipped) == (1, 2 if is_ci else 3)
    assert tally.failures == ['FAILED a.lacks: skipped in continuous integration: needs tmux'] * is_ci
