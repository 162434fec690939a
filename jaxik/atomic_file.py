"""Files that are complete or not there."""

import errno
import os
import secrets
from pathlib import Path


def write_atomically(path: str | os.PathLike[str], content: bytes | str) -> None:
    """Write a file so that no reader, and no crash, ever sees half of it.

    The content goes to a temporary file in the same folder, which takes the file's place once it is on the disk. The
    file has the permissions that the process gives to new files; a symbolic link stays and its target is replaced.

    Args:
        path: File name; an existing file is replaced.
        content: Bytes, or text that is stored as UTF-8.

    Raises:
        OSError: If the file cannot be written; carries ``path``, and an existing file is as it was.
    """
    data = content.encode("utf-8") if isinstance(content, str) else content
    final = Path(os.path.realpath(path))
    # 40 characters: a name of the greatest length still has room for the rest.
    temporary = final.with_name(f".{final.name[:40]}.{secrets.token_hex(8)}.part")
    try:
        if final.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        try:
            with open(temporary, "xb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            os.replace(temporary, final)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise
    except OSError as error:
        if error.errno is None:  # Python's own, without a file name
            raise
        raise OSError(error.errno, error.strerror, os.fspath(path)) from None
