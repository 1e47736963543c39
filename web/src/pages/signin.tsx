// Who has no key that the service knows is asked for one. The browser keeps it in a cookie, out of the reach of scripts.

import { useState } from 'preact/hooks';
import { answer, unknown, words } from '../api/client';

/** Whether this browser was given a key; the cookie itself cannot be seen from here. */
const GIVEN = 'meshway.signed-in';

async function signIn(key: string): Promise<void> {
  await answer('/v1/session', { method: 'POST', headers: { authorization: `Bearer ${key}` } });
  localStorage.setItem(GIVEN, 'yes');
  location.reload();
}

async function signOut(): Promise<void> {
  await answer('/v1/session', { method: 'DELETE' });
  localStorage.removeItem(GIVEN);
  location.reload();
}

export function SignInPage() {
  const [key, setKey] = useState('');
  const [fault, setFault] = useState('');
  return (
    <>
      <h1 tabIndex={-1}>Sign in</h1>
      <p>This service knows its users by keys. Ask its operator for one; it begins with <code>mw_</code>.</p>
      <form class="sign-in" onSubmit={(event) => {
        event.preventDefault();
        signIn(key).catch((error: unknown) => setFault(words(error)));
      }}>
        <div class="field">
          <label for="key">Key</label>
          <input id="key" type="password" autocomplete="current-password" required value={key}
            pattern="\s*mw_[0-9A-Za-z]+\s*" title="mw_ and letters and digits"
            aria-invalid={fault !== ''} aria-describedby={fault ? 'key-fault' : undefined}
            onInput={(event) => { setKey(event.currentTarget.value.trim()); setFault(''); }} />
          {fault && <p id="key-fault" class="fault" role="alert">{fault}</p>}
        </div>
        <button type="submit" class="primary large">Sign in</button>
      </form>
    </>
  );
}

export function SignOut() {
  if (unknown.value || localStorage.getItem(GIVEN) === null) return null;
  return <button type="button" class="plain" onClick={() => void signOut()}>Sign out</button>;
}
