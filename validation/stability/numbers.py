"""Numbers that others printed: walls, an arch, an incline.

Sources stand in `validation.comparison.others`; `python -m tests.verification printed` prints the
same numbers as a table.
"""

from __future__ import annotations

from functools import partial

from validation.comparison import others
from validation.stability.case import Cases, Check, Finding

CASES = Cases("numbers")

#: Half a unit of the third printed digit.
_THIRD_DIGIT = 0.5e-3
#: Half a unit of the last printed digit of the arch's h/R.
_ARCH_DIGIT = 0.5e-6


def _wall(name: str) -> Finding:
    found, (associated, sliding) = others.wall_factors(name), others.PRINTED[name]
    assert found.check is not None
    return Finding(
        Check("with dilation, off", abs(found.associated - associated), _THIRD_DIGIT),
        # A certified state below the printed factor is a better minimum of the same program.
        Check("without, above printed", found.factor - sliding, _THIRD_DIGIT),
        Check("certified", found.certified, least=1),
        Check("laws broken by", found.check.largest, 1e-6),
    )


for _name in others.WALLS:
    CASES.add(
        f"ferris-tin-loi-{_name.lower()}",
        f"Wall {_name} of Ferris and Tin-Loi: collapse factors with dilation and without",
        slow=_name == "W2",
    )(partial(_wall, _name))


@CASES.add("arch-of-27", "Arch of 27 straight voussoirs, μ = 0.5: stands from h/R = 0.106721 on")
def _arch() -> Finding:
    thick = others.straight_arch_stands(others.ARCH_OF_27 + _ARCH_DIGIT)
    thin = others.straight_arch_stands(others.ARCH_OF_27 - _ARCH_DIGIT)
    return Finding(Check("stands above", thick, least=1), Check("stands below", thin, most=0))


@CASES.add("incline-of-a-half", "Incline of slope 0.5: a block stays with μ = 0.50, not with 0.49")
def _incline() -> Finding:
    slopes = {mu: others.incline_slope(mu) for mu in (0.50, 0.49)}
    return Finding(
        *(Check(f"slope for μ = {mu}, off", abs(s - mu), 1e-7) for mu, s in slopes.items())
    )
