"""Several processes at the jobs give the rows of one, and a method's jobs stay done when another method changes."""

import ast
from pathlib import Path
from typing import ClassVar

import pytest

from kernels.errors import InputError
from tests.samples.fake_experiment import JOBS, Fake, origin
from tests.tools.reproduce.test_reproduce_journal import silence
from tools.methods.sources import decisive, method_digest
from tools.reproduce.crew import Crew
from tools.reproduce.experiment import Outcome
from tools.reproduce.experiments import Request
from tools.reproduce.run import Way, run


def crew(workers: int, scene: str | None = None, module: str = "tests.samples.crew_experiment") -> Crew:
    return Crew(workers, module, Request(scene=scene), None)


class TestCrew:
    def test_rows_are_those_of_one_process(self, tmp_path: Path) -> None:
        fake = Fake()
        alone = run(fake, origin(fake), tmp_path / "alone", silence)
        result = run(Fake(), origin(fake), tmp_path / "crew", silence, Way(crew=crew(2)))
        # by text, as one of the values is NaN
        assert str(list(result.outcomes.items())) == str(list(alone.outcomes.items()))
        assert list(result.took) == list(JOBS)

    def test_what_is_finished_is_kept_and_the_rest_done_later(self, tmp_path: Path) -> None:
        with pytest.raises(KeyboardInterrupt):
            run(Fake(), origin(Fake()), tmp_path, silence, Way(crew=crew(1, scene="c")))
        again = Fake()
        run(again, origin(again), tmp_path, silence)
        assert again.ran == ["c", "d", "e"]

    def test_the_error_of_a_job_comes_through(self, tmp_path: Path) -> None:
        with pytest.raises(InputError, match="no scene is called 'b'"):
            run(Fake(), origin(Fake()), tmp_path, silence, Way(crew=crew(1, scene="error b")))

    def test_a_killed_process_is_told(self, tmp_path: Path) -> None:
        with pytest.raises(InputError, match="use fewer"):
            run(Fake(), origin(Fake()), tmp_path, silence, Way(crew=crew(1, scene="kill b")))


class Two(Fake):
    """Jobs of two methods in two batches."""

    methods = ("mine", "yours")
    deciding: ClassVar = {"edge": 64}

    def jobs(self) -> list[str]:
        return [f"{batch}/{method}" for batch in "ab" for method in self.methods]

    def run(self, job: str) -> Outcome:
        self.ran.append(job)
        return Outcome(({"job": job},))


class TestMethods:
    def test_a_change_of_one_method_leaves_the_other_done(self, tmp_path: Path) -> None:
        def jobs_run(mine: str) -> list[str]:
            two = Two()
            methods = {name: origin(two, name=f"two-{name}") for name in two.methods}
            methods["mine"] = origin(two, name="two-mine", sources=mine)
            result = run(two, origin(two), tmp_path, silence, Way(methods=methods))
            assert list(result.outcomes) == ["a/mine", "a/yours", "b/mine", "b/yours"]
            return two.ran

        assert jobs_run("one") == ["a/mine", "a/yours", "b/mine", "b/yours"]
        assert jobs_run("one") == []
        assert jobs_run("other") == ["a/mine", "b/mine"]

    @pytest.fixture
    def project(self, tmp_path: Path) -> Path:
        files = {
            "kernels/fft.cl": "__kernel",
            "tools/methods/registry.py": "import tools.heavy\n"
            "def _a(setup):\n    import tools.a\n    return _both()\n"
            "def _b(setup):\n    import tools.b\n    return _both()\n"
            "def _both():\n    import tools.both\n",
            **{f"tools/{name}.py": "x = 1" for name in ("a", "b", "both", "heavy", "pairs_of")},
            "tools/experiment.py": "from tools import pairs_of\nimport tools.methods.registry",
        }
        for name, text in files.items():
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / name).write_text(text)
        return tmp_path

    @pytest.mark.parametrize(
        ("name", "a", "b"),
        [
            ("tools/a.py", True, False),
            ("tools/b.py", False, True),
            ("tools/both.py", True, True),
            ("tools/pairs_of.py", True, True),
            ("tools/experiment.py", True, True),
            ("tools/heavy.py", False, False),
            ("kernels/fft.cl", True, False),
        ],
    )
    def test_which_code_decides_a_method(self, project: Path, name: str, a: bool, b: bool) -> None:
        def digests() -> tuple[str, str]:
            module = project / "tools/experiment.py"
            return method_digest("_a", True, [module], project), method_digest("_b", False, [module], project)

        before = digests()
        assert digests() == before
        (project / name).write_text((project / name).read_text() + "\ny = 2")
        after = digests()
        assert (before[0] != after[0], before[1] != after[1]) == (a, b)

    def test_the_table_counts_only_where_the_method_stands(self, project: Path) -> None:
        module, table = project / "tools/experiment.py", project / "tools/methods/registry.py"
        before = [method_digest(make, False, [module], project) for make in ("_a", "_b")]
        table.write_text(table.read_text().replace("import tools.b\n", "import tools.b as b\n"))
        after = [method_digest(make, False, [module], project) for make in ("_a", "_b")]
        assert (after[0] == before[0], after[1] == before[1]) == (True, False)

    def test_peers_do_not_depend_on_the_spectral_method(self) -> None:
        from tools.methods.registry import METHODS
        from tools.methods.sources import ROOT, TABLE, _called, imported, imports
        from tools.reproduce.evaluation.lineup import EVALUATED

        table = ROOT / TABLE
        for name in EVALUATED:
            called = _called(ast.parse(table.read_bytes()), METHODS[name].make.__name__)
            files = imported([file for one in called for file in imports(one)], left_out=[table])
            spectral = "device" in METHODS[name].hears
            assert (ROOT / "spectral/translation.py" in files) is spectral, name
            assert any("baselines" in str(file) for file in files) is not spectral, name

    def test_words_decide_nothing(self) -> None:
        said = 'def f():\n    """Says."""  # so\n    return "x"\nclass A:\n    """Says."""\n'
        told = said.replace("Says", "Tells").replace("# so", "")
        other = said.replace('"x"', '"y"')
        assert decisive(ast.parse(said)) == decisive(ast.parse(told)) != decisive(ast.parse(other))
