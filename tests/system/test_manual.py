"""Man pages and shell completion are made from the commands and work in their programs."""

import re
import shutil
import subprocess

import pytest

from conftest import PROGRAM


@pytest.fixture(scope="module")
def manual(tmp_path_factory):
    folder = tmp_path_factory.mktemp("manual")
    subprocess.run([PROGRAM, "manual", "-o", folder, "-q"], check=True, capture_output=True)
    return folder


def needs(program):
    return pytest.mark.skipif(shutil.which(program) is None, reason=f"needs {program}")


def commands(malus):
    listed = malus("--help").out.split("Subcommands:")[1]
    return re.findall(r"^  ([a-z][\w-]*)", listed, re.MULTILINE)


def test_every_command_has_a_page(malus, manual):
    pages = {path.name for path in (manual / "man/man1").iterdir()}
    assert pages == {"malus.1", *(f"malus-{command}.1" for command in commands(malus))}


def long_flags(text):
    return set(re.findall(r"--[a-z][\w-]*", text))


@needs("man")
def test_a_page_holds_every_flag_of_help(malus, manual):
    names = [f"malus-{command}" for command in commands(malus)]
    shown = subprocess.run(["man", "-l", *(manual / f"man/man1/{name}.1" for name in names)], capture_output=True, text=True,
                           check=True, env={"MANWIDTH": "400", "PATH": "/usr/bin:/bin", "LC_ALL": "C.UTF-8"}).stdout
    parts = re.split(r"^(MALUS-[A-Z-]+)\(1\).*$", shown, flags=re.MULTILINE)
    pages = dict(zip(parts[1::2], parts[2::2]))
    assert list(pages) == [name.upper() for name in names]
    for name in names:
        options = malus(name.removeprefix("malus-"), "--help").out.split("Options:")[1].split("Subcommands:")[0]
        flags = long_flags("\n".join(re.findall(r"^ +(-.*?)(?:  |$)", options, re.MULTILINE)))
        missing = flags - long_flags(pages[name.upper()])
        assert len(flags) > 0 and not missing, f"{name}: {missing}"


@needs("mandoc")
def test_pages_are_free_of_mistakes(manual):
    pages = sorted((manual / "man/man1").iterdir())
    done = subprocess.run(["mandoc", "-T", "lint", "-W", "warning", *pages], capture_output=True, text=True)
    # A date would differ from build to build.
    wrong = [line for line in done.stdout.splitlines() if "missing date" not in line]
    assert not wrong, "\n".join(wrong[:20])


def bash_offers(manual, *words):
    script = f'''source {manual}/bash-completion/completions/malus
        COMP_WORDS=({" ".join(f"'{word}'" for word in words)}); COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1)); _malus
        echo "${{COMPREPLY[@]}}"'''
    return subprocess.run(["bash", "-uc", script], capture_output=True, text=True, check=True).stdout.split()


def fish_offers(manual, *words):
    script = f"source {manual}/fish/vendor_completions.d/malus.fish; complete -C '{' '.join(words)}'"
    out = subprocess.run(["fish", "--no-config", "-c", script], capture_output=True, text=True, check=True).stdout
    return [line.split("\t")[0] for line in out.splitlines()]


def zsh_offers(manual, tmp_path, *words):
    """Drives an interactive zsh in a terminal of its own: what it lists after a Tab."""
    script = f'''
        zmodload zsh/zpty
        zpty shell zsh -f -i
        zpty -w shell "PROMPT='> '; cd {tmp_path}; fpath=({manual}/zsh/vendor-completions \\$fpath)"
        zpty -w shell "autoload -Uz compinit; compinit -u -d {tmp_path}/dump; setopt list_rows_first; LISTMAX=1000; echo READY-\\$((1+1))"
        zpty -r shell out '*READY-2*'
        zpty -n -w shell $'{" ".join(words)}\\t\\t'
        for i in 1 2 3 4 5 6 7 8 9 10; do
          sleep 0.15; while zpty -r -t shell chunk; do print -rn -- $chunk; done
        done
        zpty -d shell'''
    out = subprocess.run(["zsh", "-fc", script], capture_output=True, text=True, timeout=60).stdout
    return re.findall(r"[\w-]+", re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", " ", out))


SHELLS = [pytest.param(name, marks=needs(name)) for name in ("bash", "zsh", "fish")]


@pytest.fixture
def offers(manual, tmp_path):
    def ask(shell, *words):
        if shell == "zsh":
            return zsh_offers(manual, tmp_path, *words)
        return {"bash": bash_offers, "fish": fish_offers}[shell](manual, *words)

    return ask


@pytest.mark.parametrize("shell", SHELLS)
def test_script_is_accepted(manual, shell):
    script = {"bash": "bash-completion/completions/malus", "zsh": "zsh/vendor-completions/_malus",
              "fish": "fish/vendor_completions.d/malus.fish"}[shell]
    subprocess.run([shell, "-n", manual / script], check=True, capture_output=True)


@pytest.mark.parametrize("shell", SHELLS)
def test_commands_are_offered(offers, shell):
    offered = offers(shell, "malus", "s")
    assert {"synthesize", "simulate", "stokes"} <= set(offered)
    assert "denoise" not in offered


@pytest.mark.parametrize("shell", SHELLS)
def test_commands_of_a_command_are_offered(offers, shell):
    assert {"show", "list", "check"} <= set(offers(shell, "malus", "model", ""))


@pytest.mark.parametrize("shell", SHELLS)
def test_flags_are_offered(offers, shell):
    offered = set(offers(shell, "malus", "denoise", "--"))
    assert {"--model", "--uncertainty", "--json"} <= offered
    assert "--world" not in offered


@pytest.mark.parametrize("shell", SHELLS)
def test_values_of_a_flag_are_offered(offers, shell):
    offered = offers(shell, "malus", "synthesize", "--kind", "p")
    assert {"physics", "poisson-gaussian"} <= set(offered)
    assert "gaussian" not in offered


# Names that no declaration of a flag has: of methods, of layouts, of built-in models.
@pytest.mark.parametrize("words, some, none", [
    (("denoise", "--method", ""), {"bm3d", "nl-ridge", "paper-bm3d"}, "mono"),
    (("info", "--layout", "po"), {"polar-mono", "polar-bayer-rggb"}, "mono"),
    (("denoise", "--model", "imx"), {"imx250mzr-simulated", "imx250myr-simulated"}, "sony-a7s2"),
    (("model", "show", "imx"), {"imx250mzr-simulated", "imx250myr-simulated"}, "sony-a7s2"),
])
@pytest.mark.parametrize("shell", SHELLS)
def test_names_that_the_program_knows_are_offered(offers, shell, words, some, none):
    offered = offers(shell, "malus", *words)
    assert some <= set(offered) and none not in offered


@needs("bash")
def test_files_are_offered_beside_names_where_they_are_taken(manual, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "imx of mine.h5").touch()
    (tmp_path / "polar.tif").touch()
    assert "mine.h5" in bash_offers(manual, "malus", "denoise", "--model", "imx")
    assert "mine.h5" in bash_offers(manual, "malus", "denoise", "--method", "imx")
    assert "polar.tif" not in bash_offers(manual, "malus", "info", "--layout", "po")


def test_pages_are_not_written_over(malus, refused, tmp_path):
    malus("manual", "-o", tmp_path)
    assert "--force" in refused("manual", "-o", tmp_path)
    malus("manual", "-o", tmp_path, "--force")
