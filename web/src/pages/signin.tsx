// Who is not known to the service is asked for a name and a password, or for a key. The browser keeps a session, or the
// key, in a cookie, out of the reach of scripts.

import { useState } from 'preact/hooks';
import { answer, unknown, words } from '../api/client';
import { known, session } from '../state/session';

/** Bytes of the text in UTF-8, in Base64. */
function base64(text: string): string {
  return btoa(String.fromCharCode(...new TextEncoder().encode(text)));
}

async function signIn(authorization: string): Promise<void> {
  await answer('/v1/session', { method: 'POST', headers: { authorization } });
  location.reload();
}

async function signOut(): Promise<void> {
  await answer('/v1/session', { method: 'DELETE' });
  location.reload();
}

export function SignInPage() {
  return (
    <>
      <h1 tabIndex={-1}>Sign in</h1>
      <p>This service knows its users by a name and a password, or by a key. Ask its operator for one.</p>
      <WithPassword />
      <h2>With a key</h2>
      <WithKey />
    </>
  );
}

function WithPassword() {
  const [name, setName] = useState('');
  const [password, setPassword] = useState('');
  const [fault, setFault] = useState('');
  return (
    <form class="sign-in" onSubmit={(event) => {
      event.preventDefault();
      signIn(`Basic ${base64(`${name}:${password}`)}`).catch((error: unknown) => setFault(words(error)));
    }}>
      <div class="field">
        <label for="name">Name</label>
        <input id="name" autocomplete="username" required value={name}
          onInput={(event) => { setName(event.currentTarget.value.trim()); setFault(''); }} />
      </div>
      <div class="field">
        <label for="password">Password</label>
        <input id="password" type="password" autocomplete="current-password" required value={password}
          aria-invalid={fault !== ''} aria-describedby={fault ? 'password-fault' : undefined}
          onInput={(event) => { setPassword(event.currentTarget.value); setFault(''); }} />
        {fault && <p id="password-fault" class="fault" role="alert">{fault}</p>}
      </div>
      <button type="submit" class="primary large">Sign in</button>
    </form>
  );
}

function WithKey() {
  const [key, setKey] = useState('');
  const [fault, setFault] = useState('');
  return (
    <form class="sign-in" onSubmit={(event) => {
      event.preventDefault();
      signIn(`Bearer ${key}`).catch((error: unknown) => setFault(words(error)));
    }}>
      <div class="field">
        <label for="key">Key</label>
        <input id="key" type="password" autocomplete="off" required value={key}
          pattern="\s*mw_[0-9A-Za-z]+\s*" title="mw_ and letters and digits"
          aria-invalid={fault !== ''} aria-describedby={fault ? 'key-fault' : undefined}
          onInput={(event) => { setKey(event.currentTarget.value.trim()); setFault(''); }} />
        {fault && <p id="key-fault" class="fault" role="alert">{fault}</p>}
      </div>
      <button type="submit" class="plain large">Sign in with the key</button>
    </form>
  );
}

export function SignOut() {
  if (unknown.value || !known()) return null;
  return <button type="button" class="plain" title={`Signed in as ${session.value?.name ?? ''}`} onClick={() => void signOut()}>Sign out</button>;
}
