"""Informed consent, and the text with which that of a new study begins.

A placeholder is a name in double brackets, `[[institution]]`. Publishing refuses a text that still
has one.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from experiments.definition.step import Step, Version
from surveys.documents import Problem, Text
from surveys.documents import gettext_noop as _

PLACEHOLDER = re.compile(r"\[\[[^\[\]]+\]\]")
# By language; a study in another language begins with the English one.
TEMPLATE: Mapping[str, str] = {
    "en": """\
[[institution]] invites you to take part in this study. You will drive a real robot in a real \
building over the Internet, and answer some questions. It takes about [[duration]].

Taking part is voluntary. You may stop at any time, without giving a reason.

Risks: [[risks]]

While you drive, we record where the robot is and how you drive it, the photos that you take with \
it, which kind of device and connection you use, and your answers. People near the robot can see \
and hear you through it if you switch on your camera and microphone. Over the Internet, only the \
people who run the robot and this study can watch your drive.

This site keeps your data for [[retention]]. Until then you can download it and have it deleted, \
on the page “Your data” or by writing to us with your participant code. Deleting removes it from \
this site, at once; backups lose it when newer ones replace them. It does not remove it from \
copies that were given out before: [[who gets copies]]. Results that were computed by then, \
probably from [[date of the analysis]] on, stay as they are.

Ethics approval: [[ethics approval]]

If you have questions, write to [[contact]].""",
    "es": """\
[[institución]] te invita a participar en este estudio. Conducirás un robot real en un edificio \
real a través de Internet y contestarás a unas preguntas. Se tarda unos [[duración]].

La participación es voluntaria. Puedes dejarlo en cualquier momento, sin dar explicaciones.

Riesgos: [[riesgos]]

Mientras conduces registramos dónde está el robot y cómo lo conduces, las fotos que hagas con él, \
qué tipo de dispositivo y de conexión usas, y tus respuestas. Quienes estén cerca del robot pueden \
verte y oírte a través de él si activas tu cámara y tu micrófono. A través de Internet, solo \
quienes se encargan del robot y de este estudio pueden ver tu recorrido.

Este sitio conserva tus datos durante [[conservación]]. Hasta entonces puedes descargarlos y \
hacer que se borren, en la página «Tus datos» o escribiéndonos con tu código de participante. Al \
borrarlos desaparecen de este sitio de inmediato; de las copias de seguridad, cuando otras más \
nuevas las sustituyen. No desaparecen de las copias que se entregaron antes: [[quién recibe \
copias]]. Los resultados que ya se hayan calculado, probablemente a partir del [[fecha del \
análisis]], se quedan como están.

Aprobación ética: [[aprobación ética]]

Si tienes preguntas, escribe a [[contacto]].""",
}

# With which the words of a new study's tick for sharing begin.
SHARING: Mapping[str, str] = {
    "en": """\
My data may be published, so that others can check and reuse it: my answers from lists, the \
robot's path and how I drove, my age as a range. Not my name, free text, photos or details of my \
device. What has been published cannot be taken back. I can also take part without this.""",
    "es": """\
Mis datos se pueden publicar para que otras personas los comprueben y los reutilicen: mis \
respuestas de listas, el recorrido del robot y cómo conduje, y mi edad por intervalos. No mi \
nombre, ni texto libre, fotos o detalles de mi dispositivo. Lo publicado no se puede retirar. \
También puedo participar sin esto.""",
}


class Consent(Step, frozen=True, kw_only=True, tag="consent"):
    """The participant agrees to `text`, or leaves. Participants younger than `minimum_age` are
    turned away, or need a guardian's agreement.

    With `sharing`, a separate tick with this text, which nobody has to set: public datasets are
    then of those who set it.
    """

    may_repeat: ClassVar[bool] = False
    is_for_good: ClassVar[bool] = True

    version: Version = 1
    text: Text
    sharing: Text = {}
    minimum_age: Annotated[int, Meta(ge=0, le=99)] = 18
    minors: Literal["refused", "guardian"] = "refused"

    def unfilled(self) -> Iterator[Problem]:
        """Yield, as one problem, the placeholders that the text still has, by language."""
        found = {
            language: ", ".join(dict.fromkeys(PLACEHOLDER.findall(text)))
            for language, text in self.text.items()
        }
        listed = "; ".join(f"{language}: {names}" for language, names in found.items() if names)
        if listed:
            words = _("fill in the placeholders of the text. %(placeholders)s.")
            yield Problem(words, {"placeholders": listed})

    @classmethod
    def problems_among(cls, steps: Sequence[Step]) -> Iterator[Problem]:
        """Yield that there are several, or that something comes before it."""
        count = sum(isinstance(step, cls) for step in steps)
        if count > 1:
            yield Problem(_("There are %(n)d consent steps; only one is allowed."), {"n": count})
        if count and not isinstance(steps[0], cls):
            yield Problem(_("The consent must be the first step."))
