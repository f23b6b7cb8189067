"""Static files under names that hold their hash, so that browsers may keep them for ever, each with
its compressed copy beside it.
"""

from whitenoise.storage import CompressedManifestStaticFilesStorage

# Anchored to what our modules write, because their comments name modules too, in circles: `@param
# {import("./peer.js").Peer} peer`. A test reads the collected files to see that none was missed.
IMPORTS = (
    (
        r"""(?m)^(?P<matched>(?P<names>(?:import|export)\b[^"';]*)"(?P<url>\.[^"]+)";)""",
        """%(names)s"%(url)s";""",
    ),
    (r"""(?P<matched>import\("(?P<url>\.[^"]+)"\)(?=\)))""", """import("%(url)s")"""),
)


class HashedModules(CompressedManifestStaticFilesStorage):
    """Hashed names inside JavaScript modules' imports too; without that a module would load twice,
    under both names.

    Nothing else in a script is changed: what a visitor's browser runs is what was written and
    tested (docs/explanation/decisions/).
    """

    # A name is known once the names of all that the module imports are: a pass for each module of
    # the longest chain, if they come in the worst order.
    max_post_process_passes = 50
    patterns = (*CompressedManifestStaticFilesStorage.patterns, ("*.js", IMPORTS))
