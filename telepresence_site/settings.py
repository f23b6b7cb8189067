"""Settings of the site. What differs between machines is read from environment variables
(telepresence_site/environment.py).

The defaults are for a public server: HTTPS, secure cookies, no debug. Only `HTTP_ONLY=1`, which
`make demo` sets, allows cookies over plain http, for 127.0.0.1.
"""

from pathlib import Path

import dj_database_url
from csp.constants import NONCE, NONE, SELF

from telepresence import __version__
from telepresence_site import environment as env, mongodb, postgresql

BASE_DIR = Path(__file__).resolve().parent.parent
VERSION = __version__
VAR_DIR = env.private_folder(Path(env.text("VAR_DIR", str(BASE_DIR / "var"))).resolve())

DEBUG = env.flag("DEBUG")
HTTP_ONLY = env.flag("HTTP_ONLY")
SECRET_KEY = env.text("SECRET_KEY") or env.kept_secret(VAR_DIR / "secrets" / "secret_key")
ALLOWED_HOSTS = env.words("ALLOWED_HOSTS", "127.0.0.1,localhost")
CSRF_TRUSTED_ORIGINS = env.words("CSRF_TRUSTED_ORIGINS")

INSTALLED_APPS = [
    "accounts",
    "robots",
    "sessions",
    "surveys",
    "experiments",
    "telepresence_site",
    "telepresence_site.web.administration.AdminConfig",
    "django.contrib.auth",
    "django.contrib.contenttypes",
    "django.contrib.sessions",
    "django.contrib.messages",
    "django.contrib.staticfiles",
    "django.forms",  # the templates of its widgets
    "channels",
    "allauth",
    "allauth.account",
    "csp",
]

MIDDLEWARE = [
    "telepresence_site.web.headers.PrivateAnswers",
    "telepresence_site.web.compressed_pages.CompressedPages",
    "django.middleware.security.SecurityMiddleware",
    "whitenoise.middleware.WhiteNoiseMiddleware",
    "csp.middleware.CSPMiddleware",
    "django.contrib.sessions.middleware.SessionMiddleware",
    "django.middleware.locale.LocaleMiddleware",
    "django.middleware.common.CommonMiddleware",
    "django.middleware.csrf.CsrfViewMiddleware",
    "django.contrib.auth.middleware.AuthenticationMiddleware",
    "django.contrib.messages.middleware.MessageMiddleware",
    "django.middleware.clickjacking.XFrameOptionsMiddleware",
    "accounts.rate_limits.RetryAfterMiddleware",
    "accounts.password_guesses.DeviceMiddleware",
    "allauth.account.middleware.AccountMiddleware",
    "accounts.passwordless.GuestMiddleware",
]

ROOT_URLCONF = "telepresence_site.urls"
ASGI_APPLICATION = "telepresence_site.asgi.application"

TEMPLATES = [
    {
        "BACKEND": "django.template.backends.django.DjangoTemplates",
        "DIRS": [BASE_DIR / "templates"],
        "APP_DIRS": True,
        "OPTIONS": {
            "context_processors": [
                "django.template.context_processors.request",
                "django.contrib.auth.context_processors.auth",
                "django.contrib.messages.context_processors.messages",
            ],
        },
    },
]

FORM_RENDERER = "telepresence_site.web.form_renderer.FormRenderer"

# --- data -----------------------------------------------------------------------------------------

DEFAULT_AUTO_FIELD = "django.db.models.BigAutoField"
if mongodb.is_address(env.text("DATABASE_URL")):
    DATABASES = {"default": mongodb.database(env.text("DATABASE_URL"))}
    INSTALLED_APPS = mongodb.apps(INSTALLED_APPS)
    MIGRATION_MODULES = mongodb.MIGRATION_MODULES
    DEFAULT_AUTO_FIELD = mongodb.KEY
elif postgresql.is_address(env.text("DATABASE_URL")):
    DATABASES = {"default": postgresql.database(env.text("DATABASE_URL"))}
else:
    DATABASES = {
        "default": dj_database_url.parse(
            env.text("DATABASE_URL", f"sqlite:///{VAR_DIR / 'telepresence.sqlite3'}"),
        )
    }
if DATABASES["default"]["ENGINE"] == "django.db.backends.sqlite3":
    env.private_sqlite(str(DATABASES["default"]["NAME"]))
    DATABASES["default"]["OPTIONS"] = {
        # Several processes write: wait for each other instead of failing, and take the write lock
        # when a transaction begins.
        "timeout": 20,
        "transaction_mode": "IMMEDIATE",
        # Deleted data is overwritten; `manage.py forget` empties the write-ahead log at night.
        "init_command": (
            "PRAGMA journal_mode=WAL; PRAGMA synchronous=NORMAL; PRAGMA secure_delete=ON;"
        ),
    }
    # A file, which tests share with the processes that they start.
    DATABASES["default"]["TEST"] = {"NAME": str(VAR_DIR / "test.sqlite3")}

REDIS_URL = env.text("REDIS_URL")
if REDIS_URL:
    CHANNEL_LAYERS = {
        "default": {
            "BACKEND": "channels_redis.pubsub.RedisPubSubChannelLayer",
            "CONFIG": {"hosts": [REDIS_URL]},
        }
    }
    CACHES = {
        "default": {
            "BACKEND": "telepresence_site.web.shared_cache.SharedCache",
            "LOCATION": REDIS_URL,
        }
    }
else:
    CHANNEL_LAYERS = {"default": {"BACKEND": "channels.layers.InMemoryChannelLayer"}}

# --- accounts -------------------------------------------------------------------------------------

AUTH_USER_MODEL = "accounts.User"
AUTHENTICATION_BACKENDS = [
    "django.contrib.auth.backends.ModelBackend",
    "allauth.account.auth_backends.AuthenticationBackend",
]
AUTH_PASSWORD_VALIDATORS = [
    {"NAME": "django.contrib.auth.password_validation.UserAttributeSimilarityValidator"},
    {"NAME": "django.contrib.auth.password_validation.MinimumLengthValidator"},
    {"NAME": "django.contrib.auth.password_validation.CommonPasswordValidator"},
]
LOGIN_URL = "account_login"
LOGIN_REDIRECT_URL = "home"
ACCOUNT_LOGIN_METHODS = {"username", "email"}
ACCOUNT_EMAIL_VERIFICATION = env.text("EMAIL_VERIFICATION", "none")
ACCOUNT_SIGNUP_FIELDS = [
    "username*",
    "email*" if ACCOUNT_EMAIL_VERIFICATION == "mandatory" else "email",
    "password1*",
]
ACCOUNT_ADAPTER = "accounts.adapter.AccountAdapter"
ACCOUNT_FORMS = {
    "signup": "accounts.forms.SignUpForm",
    "login": "accounts.forms.LogInForm",
    "add_email": "accounts.forms.AddEmailForm",
    "change_password": "accounts.forms.ChangePasswordForm",
    "set_password": "accounts.forms.SetPasswordForm",
    "reset_password": "accounts.forms.ResetPasswordForm",
    "reset_password_from_key": "accounts.forms.ResetPasswordKeyForm",
    "reauthenticate": "accounts.forms.ReauthenticateForm",
}
SIGNUP_OPEN = env.flag("SIGNUP_OPEN", default=True)
ACCOUNT_LOGOUT_REDIRECT_URL = "home"
ACCOUNT_EMAIL_SUBJECT_PREFIX = ""  # the sender is named
ACCOUNT_EMAIL_CONFIRMATION_HMAC = False
ACCOUNT_RATE_LIMITS = {"login_failed": "10/m/ip", "signup": "20/m/ip"}

EMAIL_HOST = env.text("EMAIL_HOST")
EMAIL_PORT = int(env.text("EMAIL_PORT", "587"))
EMAIL_HOST_USER = env.text("EMAIL_HOST_USER")
EMAIL_HOST_PASSWORD = env.text("EMAIL_HOST_PASSWORD")
EMAIL_USE_TLS = env.flag("EMAIL_USE_TLS", default=True)
DEFAULT_FROM_EMAIL = env.text("DEFAULT_FROM_EMAIL", "telepresence@localhost")
# Without a mail server, messages are stored as files for the operator.
EMAIL_BACKEND = (
    "django.core.mail.backends.smtp.EmailBackend"
    if EMAIL_HOST
    else "django.core.mail.backends.filebased.EmailBackend"
)
EMAIL_FILE_PATH = VAR_DIR / "mail"

# --- robots and sessions --------------------------------------------------------------------------

MQTT_URL = env.text("MQTT_URL", "mqtt://127.0.0.1:1883")
# Where robots reach the broker, when that differs from where the server does; {host} is the host of
# the request that asks.
MQTT_PUBLIC_URL = env.text("MQTT_PUBLIC_URL")
CREDENTIALS_DIR = VAR_DIR / "credentials"
STUN_URLS = env.words("STUN_URLS")
TURN_URLS = env.words("TURN_URLS")
TURN_SECRET = env.text("TURN_SECRET")
# The SFU for robots that many people watch: the address of Janus' WebSocket, and its api_secret.
JANUS_URL = env.text("JANUS_URL")
JANUS_SECRET = env.text("JANUS_SECRET")
# how many watch a robot directly where there is an SFU, as far as the robot has places
DIRECT_WATCHERS = int(env.text("DIRECT_WATCHERS", "8"))

TURN_MINUTES = float(env.text("TURN_MINUTES", "15"))
TURN_WARNING_SECONDS = float(env.text("TURN_WARNING_SECONDS", "120"))
START_SECONDS = float(env.text("START_SECONDS", "60"))
GRACE_SECONDS = float(env.text("GRACE_SECONDS", "30"))
# free space on the disk of VAR_DIR, below which there are warnings
DISK_LOW_MB = float(env.text("DISK_LOW_MB", "500"))
IDLE_SECONDS = float(env.text("IDLE_SECONDS", "120"))  # 0: the page never asks
# simulated ones for visitors who wait; run_practice runs them
PRACTICE_ROBOTS = int(env.text("PRACTICE_ROBOTS", "0"))
PRACTICE_MINUTES = float(env.text("PRACTICE_MINUTES", "3"))
TRIAL_SECONDS = float(env.text("TRIAL_SECONDS", "60"))
LEASE_TTL_SECONDS = 10.0
LEASE_RENEWAL_SECONDS = 2.0
TRUSTED_PROXIES = env.words("TRUSTED_PROXIES")
# Open WebSockets, in each web process.
SOCKETS_PER_ADDRESS = int(env.text("SOCKETS_PER_ADDRESS", "200"))
SOCKETS_PER_USER = int(env.text("SOCKETS_PER_USER", "20"))
# The secret part of the demo's one-click link; `manage.py demo` sets it at each start.
DEMO_TOKEN = env.text("DEMO_TOKEN")

# --- how long data is kept, in days; 0 is for ever. `manage.py forget` deletes older data ---------

RETENTION_DAYS = {
    "sessions": float(env.text("RETENTION_SESSIONS_DAYS", "365")),
    "photos": float(env.text("RETENTION_PHOTOS_DAYS", "90")),
    "network_samples": float(env.text("RETENTION_NETWORK_DAYS", "90")),
    "addresses": float(env.text("RETENTION_ADDRESSES_DAYS", "30")),
    "system_log": float(env.text("RETENTION_LOG_DAYS", "90")),
    "audit_log": float(env.text("RETENTION_AUDIT_DAYS", "1095")),
    "interventions": float(env.text("RETENTION_INTERVENTIONS_DAYS", "1827")),  # five years
}

# --- pages ----------------------------------------------------------------------------------------

LANGUAGE_CODE = "en"
LANGUAGES = [("en", "English"), ("es", "Español")]
# Our texts first, then our translations of Django and django-allauth.
LOCALE_PATHS = [BASE_DIR / "locale", BASE_DIR / "locale" / "libraries"]
TIME_ZONE = env.text("TIME_ZONE", "UTC")
USE_TZ = True
FORMAT_MODULE_PATH = ["telepresence_site.formats"]  # times with their zone
USE_I18N = True

STATIC_URL = "static/"
STATICFILES_DIRS = [BASE_DIR / "static"]
STATIC_ROOT = Path(env.text("STATIC_ROOT", str(VAR_DIR / "static")))
MEDIA_ROOT = VAR_DIR / "media"
STORAGES = {
    "default": {"BACKEND": "django.core.files.storage.FileSystemStorage"},
    # The proxy reads them as another user, whatever the umask of collectstatic.
    "staticfiles": {
        "BACKEND": "telepresence_site.web.static_files.HashedModules",
        "OPTIONS": {"directory_permissions_mode": 0o755},
    },
}
if DEBUG or env.flag("PLAIN_STATIC"):
    STORAGES["staticfiles"] = {"BACKEND": "django.contrib.staticfiles.storage.StaticFilesStorage"}
    WHITENOISE_USE_FINDERS = True

# --- security -------------------------------------------------------------------------------------

CONTENT_SECURITY_POLICY = {
    "DIRECTIVES": {
        "default-src": [SELF],
        "script-src": [SELF, NONCE],
        "style-src": [SELF],
        "img-src": [SELF, "data:", "blob:"],
        "media-src": [SELF, "blob:"],
        "connect-src": [SELF],
        "object-src": [NONE],
        "base-uri": [NONE],
        "form-action": [SELF],
        "frame-ancestors": [NONE],
    }
}
SECURE_REFERRER_POLICY = "same-origin"
SECURE_CROSS_ORIGIN_OPENER_POLICY = "same-origin"
X_FRAME_OPTIONS = "DENY"
SESSION_COOKIE_SECURE = not HTTP_ONLY
CSRF_COOKIE_SECURE = not HTTP_ONLY
SESSION_COOKIE_SAMESITE = "Lax"
CSRF_COOKIE_HTTPONLY = True
# Also behind a proxy, which sends X-Forwarded-Proto; only health checks may use plain http.
SECURE_SSL_REDIRECT = not HTTP_ONLY
SECURE_REDIRECT_EXEMPT = [r"^(healthz|readyz|metrics)$"]
SECURE_HSTS_SECONDS = 0 if HTTP_ONLY else int(env.text("HSTS_SECONDS", "3600"))
SECURE_HSTS_INCLUDE_SUBDOMAINS = env.flag("HSTS_SUBDOMAINS")
SECURE_HSTS_PRELOAD = env.flag("HSTS_PRELOAD")
# HSTS for a whole domain and for years is for the operator to decide; it is off by default.
SILENCED_SYSTEM_CHECKS = ["security.W005", "security.W021"]
if env.flag("BEHIND_TLS_PROXY"):
    SECURE_PROXY_SSL_HEADER = ("HTTP_X_FORWARDED_PROTO", "https")
DATA_UPLOAD_MAX_MEMORY_SIZE = 1024 * 1024
# The page that finishes a large floor plan has 100 rooms, 100 openings and 200 places, with several
# fields each.
DATA_UPLOAD_MAX_NUMBER_FIELDS = 4000

# /metrics is for clients with the token and for direct connections from these addresses or
# networks; without either, for no one.
METRICS_TOKEN = env.text("METRICS_TOKEN")
METRICS_ALLOWED = env.words("METRICS_ALLOWED")
LOG_FORMAT = env.text("LOG_FORMAT", "text")

LOGGING = {
    "version": 1,
    "disable_existing_loggers": False,
    "formatters": {
        "json": {"()": "telepresence_site.ops.log_lines.json_lines"},
        "text": {"()": "telepresence_site.ops.log_lines.key_value_lines"},
    },
    "handlers": {
        "console": {
            "class": "logging.StreamHandler",
            "formatter": "json" if LOG_FORMAT == "json" else "text",
        }
    },
    "root": {"handlers": ["console"], "level": env.text("LOG_LEVEL", "INFO")},
    # it logs every table of the font in each figure
    "loggers": {"fontTools": {"level": "WARNING"}},
}
